"""Results of the suite's rows with a mutation between suite and server."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

from conformance.check import ServerUnderTest
from conformance.mutation import ConnectionMutation, Mutation
from conformance.mutation_proxy import run_mutation_proxy
from conformance.suite import Outcome, RowResult, applicable_checks, play_check

UNMUTATED_NAME = "unmutated"


def make_unmutated(port: str) -> Mutation:
    """The proxy of a port alone."""
    return Mutation(UNMUTATED_NAME, port, ConnectionMutation)


def play_rows(mutation: Mutation, server: ServerUnderTest, names: Sequence[str]) -> list[RowResult]:
    """Results of some rows, through the mutation."""
    port = mutation.port
    with run_mutation_proxy(port, server.addresses[port], mutation.connect) as proxy:
        mutated = dataclasses.replace(server, addresses={**server.addresses, port: proxy})
        checks = {one.name: one for one in applicable_checks(mutated)}
        return [play_check(checks[name], mutated) for name in names]


def find_failures(results: Iterable[RowResult]) -> dict[str, str]:
    """Reason of each failed row by name."""
    return {one.check.name: one.reason for one in results if one.outcome is Outcome.FAILED}
