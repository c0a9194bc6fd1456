"""Each mutation of the control port is noticed by the rows that its table names.

All mutations are played at once, each in a walled cell of one world, since most of their time is
the duration of drives; each test looks at the result of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future

import pytest

from conformance.control_mutations import CONTROL_MUTATIONS
from conformance.mutation import Mutation
from conformance.mutation_play import UNMUTATED_NAME, find_failures, make_unmutated
from conformance.parallel_play import places_of, run_parallel_player
from conformance.server_setup import server_under_test
from conformance.suite import Outcome, RowResult
from helpers.cell_world import CELL_POSES, write_cell_world, write_sensor_robot
from helpers.server_process import start_server

Plays = dict[tuple[str, str], "Future[RowResult]"]
"""Result of each mutation and row."""


@pytest.fixture(scope="module")
def plays(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Plays]:
    """Plays of the mutations whose tests were selected, with and without the mutation."""
    folder = tmp_path_factory.mktemp("cells")
    robot, world = write_sensor_robot(folder), write_cell_world(folder)
    selected = [one for one in CONTROL_MUTATIONS if _is_selected(one, request)]
    pairs = [(mutation, row) for mutation in selected for row in mutation.noticed_by]
    unmutated = make_unmutated("control")
    pairs += [(unmutated, row) for row in sorted({row for _, row in pairs})]
    with (
        start_server(folder, robot=robot, world=world) as server,
        run_parallel_player(places_of(server_under_test(server), CELL_POSES)) as player,
    ):
        yield {(one.name, row): player.start(one, row) for one, row in pairs}


@pytest.mark.parametrize("mutation", CONTROL_MUTATIONS, ids=lambda mutation: mutation.name)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, plays: Plays
) -> None:
    for row in mutation.noticed_by:
        unmutated, mutated = (plays[name, row].result() for name in (UNMUTATED_NAME, mutation.name))
        assert unmutated.outcome is Outcome.PASSED, unmutated.reason
        assert row in find_failures([mutated])


def test_mutations_when_listed_have_names_of_their_own_and_a_row_that_notices_them() -> None:
    names = [mutation.name for mutation in CONTROL_MUTATIONS]
    assert len(names) == len(set(names))
    assert all(mutation.noticed_by for mutation in CONTROL_MUTATIONS)


def _is_selected(mutation: Mutation, request: pytest.FixtureRequest) -> bool:
    return any(item.name.endswith(f"[{mutation.name}]") for item in request.session.items)
