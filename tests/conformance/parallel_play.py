"""Rows of the control port played at once, each with a place of the world of its own.

Most of a row's time is the duration of a drive, in which neither side computes much.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from queue import SimpleQueue

from conformance.check import ServerUnderTest
from conformance.mutation import Mutation
from conformance.mutation_play import play_rows
from conformance.suite import RowResult, applicable_checks


class ParallelPlayer:
    """Threads that play rows, as many as there are places."""

    def __init__(self, places: Sequence[ServerUnderTest], executor: ThreadPoolExecutor) -> None:
        self._executor = executor
        self._free_places: SimpleQueue[ServerUnderTest] = SimpleQueue()
        for place in places:
            self._free_places.put(place)

    def start(self, mutation: Mutation, row: str, robot_class: str = "") -> Future[RowResult]:
        """Play a row through a mutation, in the next free place.

        Args:
            mutation: Mutation.
            row: Name of a conversation or check.
            robot_class: Class of INIT; empty for that of the place.
        """
        return self._executor.submit(self._play, mutation, row, robot_class)

    def play(self, mutation: Mutation, rows: Sequence[str]) -> list[RowResult]:
        """Play rows through a mutation, and wait for all."""
        return [future.result() for future in [self.start(mutation, row) for row in rows]]

    def _play(self, mutation: Mutation, row: str, robot_class: str) -> RowResult:
        place = self._free_places.get()
        server = dataclasses.replace(place, robot_class=robot_class or place.robot_class)
        try:
            return play_rows(mutation, server, [row])[0]
        finally:
            self._free_places.put(place)


@contextmanager
def run_parallel_player(places: Sequence[ServerUnderTest]) -> Iterator[ParallelPlayer]:
    """Play rows for the length of a block, which ends when all are played.

    Args:
        places: One server with spawn poses whose robots neither see nor touch each other, or
            several servers.
    """
    with ThreadPoolExecutor(len(places)) as executor:
        yield ParallelPlayer(places, executor)


def places_of(server: ServerUnderTest, poses: Sequence[str]) -> list[ServerUnderTest]:
    """A server at each of these spawn poses (blocks of INIT)."""
    return [dataclasses.replace(server, spawn_pose=pose) for pose in poses]


def parallel_rows(server: ServerUnderTest, port: str) -> list[str]:
    """Names of the rows of a port that may be played at once."""
    return [
        check.name
        for check in applicable_checks(server)
        if check.port == port and not check.needs_empty_world
    ]
