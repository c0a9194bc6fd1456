"""Fixtures of the rows of pictures, on the image port and on the stream, and of their mutations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import pytest

from conformance.check import ServerUnderTest
from conformance.mutation import Mutation
from conformance.mutation_play import find_failures, make_unmutated, play_rows
from conformance.server_setup import server_under_test
from conformance.suite import Outcome, RowResult
from helpers.configs import OMNI_ROBOT
from helpers.server_process import start_server

PlayUnmutated = Callable[[str, str], RowResult]
RequireNoticed = Callable[[Mutation], None]


@pytest.fixture(scope="module")
def picture_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerUnderTest]:
    """A server with the field, and a robot with the camera of the bundled file."""
    folder = tmp_path_factory.mktemp("server")
    with start_server(folder, "--image-type", "GOOD", robot=OMNI_ROBOT) as running:
        yield server_under_test(running, spawn_pose="{Start Centre}")


@pytest.fixture(scope="module")
def play_unmutated(picture_server: ServerUnderTest) -> PlayUnmutated:
    """Result of a row of a port without a mutation; played once for all tests."""

    @cache
    def play(port: str, row: str) -> RowResult:
        return play_rows(make_unmutated(port), picture_server, [row])[0]

    return play


@pytest.fixture(scope="module")
def require_noticed(
    picture_server: ServerUnderTest, play_unmutated: PlayUnmutated
) -> RequireNoticed:
    """Assertion that the rows of a mutation fail with it, and pass through the proxy without it."""

    def require(mutation: Mutation) -> None:
        for row in mutation.noticed_by:
            unmutated = play_unmutated(mutation.port, row)
            assert unmutated.outcome is Outcome.PASSED, unmutated.reason
        failures = find_failures(play_rows(mutation, picture_server, mutation.noticed_by))
        assert set(failures) == set(mutation.noticed_by)

    return require
