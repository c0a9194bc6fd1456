"""Our server passes each row of image port and stream; rows of their tables notice mutations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from conformance.check import ServerUnderTest
from conformance.image_mutations import IMAGE_MUTATIONS
from conformance.mutation import Mutation
from conformance.mutation_play import find_failures, make_unmutated, play_rows
from conformance.mutations import STREAM_MUTATIONS
from conformance.server_setup import server_under_test
from conformance.suite import Outcome, RowResult, applicable_checks, play_checks
from helpers.configs import OMNI_ROBOT, ROBOTS
from helpers.long_cases import one_of_each
from helpers.server_process import start_server

PlayUnmutated = Callable[[str, str], RowResult]
SPAWN_POSE = "{Start Centre}"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerUnderTest]:
    """A server with the field, and a robot with the camera of the bundled file."""
    folder = tmp_path_factory.mktemp("server")
    with start_server(folder, "--image-type", "GOOD", robot=OMNI_ROBOT) as running:
        yield server_under_test(running, spawn_pose=SPAWN_POSE)


@pytest.fixture(scope="module")
def play_unmutated(server: ServerUnderTest) -> PlayUnmutated:
    """Result of a row of a port without a mutation; played once for all tests."""

    @cache
    def play(port: str, row: str) -> RowResult:
        return play_rows(make_unmutated(port), server, [row])[0]

    return play


@pytest.mark.parametrize("port", ["image", "stream"])
def test_our_server_passes_each_row(
    port: str, server: ServerUnderTest, play_unmutated: PlayUnmutated
) -> None:
    rows = [check.name for check in applicable_checks(server) if check.port == port]
    results = [play_unmutated(port, row) for row in rows]
    # Nor is a row skipped.
    assert [one for one in results if one.outcome is not Outcome.PASSED] == []


# `make mutations` plays all of them.
@pytest.mark.parametrize(
    "mutation",
    one_of_each((*IMAGE_MUTATIONS, *STREAM_MUTATIONS), lambda mutation: mutation.noticed_by),
    ids=lambda mutation: mutation.name,
)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, server: ServerUnderTest, play_unmutated: PlayUnmutated
) -> None:
    for row in mutation.noticed_by:
        unmutated = play_unmutated(mutation.port, row)
        assert unmutated.outcome is Outcome.PASSED, unmutated.reason
    failures = find_failures(play_rows(mutation, server, mutation.noticed_by))
    assert set(failures) == set(mutation.noticed_by)


# A lens states no field of view on a plane; a ball's rays do not meet in one point.
@pytest.mark.parametrize(
    ("robot", "class_name", "rows"),
    [
        ("p2at_fisheye", "FisheyeP2AT", {"image_turn", "stream_turn", "stream_server_info"}),
        ("p2at_sphere", "SphereP2AT", {"image_turn", "stream_landmark_pixels"}),
    ],
)
def test_our_server_with_another_lens_or_mirror_passes(
    tmp_path: Path, robot: str, class_name: str, rows: set[str]
) -> None:
    with start_server(tmp_path, robot=ROBOTS / f"{robot}.ini") as running:
        server = server_under_test(
            running, robot_class=f"USARBot.{class_name}", spawn_pose=SPAWN_POSE
        )
        checks = [check for check in applicable_checks(server) if check.name in rows]
        results = list(play_checks(checks, server))
    assert {one.check.name for one in results} == rows
    assert [one for one in results if one.outcome is not Outcome.PASSED] == []
