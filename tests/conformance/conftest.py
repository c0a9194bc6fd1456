"""Fixtures of the mutations of pictures, on the image port and on the stream."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import pytest

from conformance.mutation import Mutation
from conformance.mutation_play import find_failures, make_unmutated, play_rows
from conformance.server_setup import server_under_test
from conformance.suite import Outcome, RowResult
from helpers.configs import OMNI_ROBOT
from helpers.server_process import start_server

RequireNoticed = Callable[[Mutation], None]


@pytest.fixture(scope="module")
def require_noticed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RequireNoticed]:
    """Assertion that the rows of a mutation fail with it, and pass through the proxy without it.

    The server has the field, and a robot with the camera of the bundled file.
    """
    with start_server(tmp_path_factory.mktemp("server"), robot=OMNI_ROBOT) as running:
        server = server_under_test(running, spawn_pose="{Start Centre}")

        @cache
        def play_unmutated(port: str, row: str) -> RowResult:
            return play_rows(make_unmutated(port), server, [row])[0]

        def require(mutation: Mutation) -> None:
            for row in mutation.noticed_by:
                unmutated = play_unmutated(mutation.port, row)
                assert unmutated.outcome is Outcome.PASSED, unmutated.reason
            failures = find_failures(play_rows(mutation, server, mutation.noticed_by))
            assert set(failures) == set(mutation.noticed_by)

        yield require
