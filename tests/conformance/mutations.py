"""The matrix of mutations: which rows of the suite notice each of them.

Run: make mutations, or, in tests/, `python -m conformance.mutations`. Plays all rows of a port
against our own server, in a world of cells, and those that should notice a mutation through it;
others may wait for seconds each. Prints for each mutation the conversations and checks that fail.
Exits with 0 if every mutation is noticed and the server without a mutation passes.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table

from conformance.check import ServerUnderTest
from conformance.control_mutations import CONTROL_MUTATIONS
from conformance.image_mutations import IMAGE_MUTATIONS
from conformance.mutation import ConnectionMutation, Mutation
from conformance.mutation_play import UNMUTATED_NAME, find_failures, make_unmutated
from conformance.parallel_play import parallel_rows, places_of, run_parallel_player
from conformance.server_setup import server_under_test
from conformance.suite import read_conversations
from helpers.cell_world import CELL_POSES, write_cell_world, write_sensor_robot
from helpers.configs import OMNI_ROBOT
from helpers.server_process import start_server

# Of the stream's behaviour; mutations of its fields are generated (stream_message_mutations.py).
STREAM_MUTATIONS = (
    Mutation(
        "no heartbeat",
        "stream",
        lambda: ConnectionMutation(
            mutate_reply=lambda data: data.replace(b"heartbeat", b"heartless")
        ),
        ("stream_heartbeats",),
    ),
)
# A row waits for most of its time.
_NUM_PICTURE_SERVERS = 8


@dataclass(frozen=True, slots=True)
class MutationResult:
    """Rows that notice a mutation."""

    mutation: Mutation
    conversations: tuple[str, ...]
    checks: tuple[str, ...]

    @property
    def is_noticed(self) -> bool:
        """Whether the exit status of the suite shows it."""
        return bool(self.conversations or self.checks)


def play_mutations(
    port: str, mutations: Sequence[Mutation], places: Sequence[ServerUnderTest]
) -> list[MutationResult]:
    """Rows of a port that fail without a mutation, first, and through each mutation.

    Args:
        port: Port of the mutations.
        mutations: Mutations.
        places: Servers, or spawn poses of one, that play in turn.
    """
    rows = parallel_rows(places[0], port)
    played = [make_unmutated(port), *mutations]
    with run_parallel_player(places) as player:
        futures = [[player.start(one, row) for row in one.noticed_by or rows] for one in played]
        return [
            _result(one, find_failures(future.result() for future in rows_of_one))
            for one, rows_of_one in zip(played, futures, strict=True)
        ]


def matrix_table(results: Iterable[MutationResult]) -> Table:
    """Table of mutations and the rows that notice them."""
    table = Table("port", "mutation", "conversations that fail", "checks that fail")
    for one in results:
        columns = (", ".join(one.conversations), ", ".join(one.checks))
        table.add_row(one.mutation.port, one.mutation.name, *columns)
    return table


def summarize(results: Sequence[MutationResult]) -> str:
    """Number of mutations noticed by conversations alone, and by the whole suite."""
    return (
        f"{len(results)} mutations: conversations notice "
        f"{sum(bool(one.conversations) for one in results)}, with the checks "
        f"{sum(one.is_noticed for one in results)} are noticed"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Play the matrix; exit status."""
    parser = argparse.ArgumentParser(description="Play the suite through deliberate faults.")
    parser.add_argument("ports", nargs="*", help="control, image, stream; default: all")
    ports = parser.parse_args(arguments).ports or list(PLAYERS)
    with tempfile.TemporaryDirectory() as name:
        results = [one for port in ports for one in PLAYERS[port](Path(name) / port)]
    Console().print(matrix_table(results))
    mutated = [one for one in results if one.mutation.name != UNMUTATED_NAME]
    unmutated = [one for one in results if one.mutation.name == UNMUTATED_NAME]
    print(summarize(mutated))
    is_right = all(one.is_noticed for one in mutated) and not any(x.is_noticed for x in unmutated)
    return 0 if is_right else 1


def _play_control_mutations(folder: Path) -> list[MutationResult]:
    """In the cells of one world, since robots there do not disturb each other."""
    folder.mkdir()
    robot, world = write_sensor_robot(folder), write_cell_world(folder)
    with start_server(folder, robot=robot, world=world) as running:
        places = places_of(server_under_test(running), CELL_POSES)
        return play_mutations("control", CONTROL_MUTATIONS, places)


def _play_picture_mutations(
    port: str, mutations: Sequence[Mutation], folder: Path
) -> list[MutationResult]:
    """With several servers, since the image port shows the first robot alone."""
    with ExitStack() as stack:
        places = []
        for number in range(_NUM_PICTURE_SERVERS):
            own = folder / f"server{number}"
            own.mkdir(parents=True)
            running = stack.enter_context(start_server(own, robot=OMNI_ROBOT))
            places.append(server_under_test(running, spawn_pose="{Start Centre}"))
        return play_mutations(port, mutations, places)


def _result(mutation: Mutation, failures: dict[str, str]) -> MutationResult:
    conversations = {one.name for one in read_conversations()}
    return MutationResult(
        mutation,
        tuple(sorted(failures.keys() & conversations)),
        tuple(sorted(failures.keys() - conversations)),
    )


PLAYERS: dict[str, Callable[[Path], list[MutationResult]]] = {
    "control": _play_control_mutations,
    "image": partial(_play_picture_mutations, "image", IMAGE_MUTATIONS),
    "stream": partial(_play_picture_mutations, "stream", STREAM_MUTATIONS),
}
"""Player of the mutations of each port; its files go into a folder."""

if __name__ == "__main__":
    sys.exit(main())
