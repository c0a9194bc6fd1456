"""Results of the suite's rows with a mutation between suite and server."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

from conformance.check import ServerUnderTest
from conformance.mutation import ConnectionMutation, Mutation
from conformance.mutation_proxy import run_mutation_proxy
from conformance.suite import Outcome, RowResult, applicable_checks, play_check, play_checks

UNMUTATED = Mutation("unmutated", "control", ConnectionMutation)
"""The proxy of the control port alone."""


def play_all_rows(mutation: Mutation, server: ServerUnderTest) -> list[RowResult]:
    """Results of all rows of the mutation's port, through the mutation."""
    address = server.addresses[mutation.port]
    with run_mutation_proxy(mutation.port, address, mutation.connect) as proxy:
        mutated = _replace_address(server, mutation.port, proxy)
        checks = [one for one in applicable_checks(mutated) if one.port == mutation.port]
        return list(play_checks(checks, mutated))


def play_rows(mutation: Mutation, server: ServerUnderTest, names: Sequence[str]) -> list[RowResult]:
    """Results of some rows, through the mutation."""
    address = server.addresses[mutation.port]
    with run_mutation_proxy(mutation.port, address, mutation.connect) as proxy:
        mutated = _replace_address(server, mutation.port, proxy)
        checks = {one.name: one for one in applicable_checks(mutated)}
        return [play_check(checks[name], mutated) for name in names]


def find_failures(results: Iterable[RowResult]) -> dict[str, str]:
    """Reason of each failed row by name."""
    return {one.check.name: one.reason for one in results if one.outcome is Outcome.FAILED}


def _replace_address(
    server: ServerUnderTest, port: str, address: tuple[str, int]
) -> ServerUnderTest:
    return dataclasses.replace(server, addresses={**server.addresses, port: address})
