"""Each mutation of the stream is noticed by the rows that its table names."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import pytest

from conformance.check import ServerUnderTest
from conformance.mutation import Mutation
from conformance.mutation_play import find_failures, make_unmutated, play_rows
from conformance.server_setup import server_under_test
from conformance.stream_mutations import STREAM_MUTATIONS
from conformance.suite import Outcome, RowResult
from helpers.configs import OMNI_ROBOT
from helpers.server_process import start_server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerUnderTest]:
    """The field, and a robot with the camera of the bundled file."""
    with start_server(tmp_path_factory.mktemp("server"), robot=OMNI_ROBOT) as running:
        yield server_under_test(running, spawn_pose="{Start Centre}")


@pytest.fixture(scope="module")
def play_unmutated(server: ServerUnderTest) -> Callable[[str], RowResult]:
    """Result of a row through the proxy alone, played once."""
    return cache(lambda row: play_rows(make_unmutated("stream"), server, [row])[0])


@pytest.mark.parametrize("mutation", STREAM_MUTATIONS, ids=lambda mutation: mutation.name)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, server: ServerUnderTest, play_unmutated: Callable[[str], RowResult]
) -> None:
    for row in mutation.noticed_by:
        unmutated = play_unmutated(row)
        assert unmutated.outcome is Outcome.PASSED, unmutated.reason
    failures = find_failures(play_rows(mutation, server, mutation.noticed_by))
    assert set(failures) == set(mutation.noticed_by)
