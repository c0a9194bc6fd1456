"""Our server passes each row of the control port; each mutation is noticed by rows of its table.

All rows are played at once, each in a walled cell of one world, since most of their time is the
duration of drives; each test looks at the results of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future

import pytest

from conformance.control_mutations import CONTROL_MUTATIONS
from conformance.mutation import ConnectionMutation, Mutation
from conformance.mutation_play import UNMUTATED_NAME, find_failures, make_unmutated
from conformance.parallel_play import parallel_rows, places_of, run_parallel_player
from conformance.server_setup import server_under_test
from conformance.suite import Outcome, RowResult
from helpers.cell_world import CELL_POSES, write_cell_world, write_sensor_robot
from helpers.server_process import start_server

P2AT, KENAF = "USARBot.OmniP2AT", "Kenaf"
Plays = dict[tuple[str, str, str], "Future[RowResult]"]
"""Result of each class, mutation and row."""


def make_other_form() -> ConnectionMutation:
    """A correct server of another form: no client may depend on segments, or on a cycle's order.

    CR and LF of each line come in segments of their own, and each line of Odometry behind the line
    that followed it.
    """
    held = [b""]

    def swap_with_next(line: bytes) -> bytes:
        if b"{Type Odometry}" in line and line.startswith(b"SEN"):
            held[0] += line
            return b""
        line, held[0] = line + held[0], b""
        return line

    return ConnectionMutation(mutate_reply=swap_with_next, split_replies_before=b"\n")


UNMUTATED = make_unmutated("control")
OTHER_FORM = Mutation("another form", "control", make_other_form)
SERVERS = {"P2AT": (P2AT, UNMUTATED), "Kenaf": (KENAF, UNMUTATED), "form": (P2AT, OTHER_FORM)}
"""Class and mutation of each correct server."""


@pytest.fixture(scope="module")
def plays(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Plays]:
    """Plays of the selected tests, each class, mutation and row once."""
    folder = tmp_path_factory.mktemp("cells")
    robot, world = write_sensor_robot(folder), write_cell_world(folder)
    kenaf = write_sensor_robot(folder, "kenaf")
    with start_server(folder, "--robot", str(kenaf), robot=robot, world=world) as running:
        server = server_under_test(running)
        rows = parallel_rows(server, "control")
        correct = [one for name, one in SERVERS.items() if _is_selected(name, request)]
        selected = [one for one in CONTROL_MUTATIONS if _is_selected(one.name, request)]
        wanted = [(name, mutation, row) for name, mutation in correct for row in rows]
        wanted += [
            (P2AT, played, row)
            for mutation in selected
            for row in mutation.noticed_by
            for played in (UNMUTATED, mutation)
        ]
        with run_parallel_player(places_of(server, CELL_POSES)) as player:
            # As keys of a dict: a row without a mutation serves several tests.
            yield {
                (name, mutation.name, row): player.start(mutation, row, name)
                for name, mutation, row in dict.fromkeys(wanted)
            }


def _is_selected(name: str, request: pytest.FixtureRequest) -> bool:
    return any(item.name.endswith(f"[{name}]") for item in request.session.items)


@pytest.mark.parametrize(
    "server",
    SERVERS,
)
def test_our_server_passes_each_row(plays: Plays, server: str) -> None:
    robot_class, mutation = SERVERS[server]
    results = [
        future.result()
        for (name, mutation_name, _), future in plays.items()
        if (name, mutation_name) == (robot_class, mutation.name)
    ]
    assert results
    # Nor is a row skipped.
    assert [one for one in results if one.outcome is not Outcome.PASSED] == []


@pytest.mark.parametrize("mutation", CONTROL_MUTATIONS, ids=lambda mutation: mutation.name)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, plays: Plays
) -> None:
    for row in mutation.noticed_by:
        unmutated, mutated = (
            plays[P2AT, name, row].result() for name in (UNMUTATED_NAME, mutation.name)
        )
        assert unmutated.outcome is Outcome.PASSED, unmutated.reason
        assert row in find_failures([mutated])


def test_mutations_when_listed_have_names_of_their_own_and_a_row_that_notices_them() -> None:
    names = [mutation.name for mutation in CONTROL_MUTATIONS]
    assert len(names) == len(set(names))
    assert all(mutation.noticed_by for mutation in CONTROL_MUTATIONS)
