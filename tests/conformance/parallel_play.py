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
from conformance.suite import RowResult


class ParallelPlayer:
    """Threads that play rows, as many as there are places."""

    def __init__(
        self, server: ServerUnderTest, poses: Sequence[str], executor: ThreadPoolExecutor
    ) -> None:
        self._server = server
        self._executor = executor
        self._free_poses: SimpleQueue[str] = SimpleQueue()
        for pose in poses:
            self._free_poses.put(pose)

    def start(self, mutation: Mutation, row: str) -> Future[RowResult]:
        """Play a row through a mutation, in the next free place."""
        return self._executor.submit(self._play, mutation, row)

    def play(self, mutation: Mutation, rows: Sequence[str]) -> list[RowResult]:
        """Play rows through a mutation, and wait for all."""
        return [future.result() for future in [self.start(mutation, row) for row in rows]]

    def _play(self, mutation: Mutation, row: str) -> RowResult:
        pose = self._free_poses.get()
        try:
            server = dataclasses.replace(self._server, spawn_pose=pose)
            return play_rows(mutation, server, [row])[0]
        finally:
            self._free_poses.put(pose)


@contextmanager
def run_parallel_player(server: ServerUnderTest, poses: Sequence[str]) -> Iterator[ParallelPlayer]:
    """Play rows for the length of a block, which ends when all are played.

    Args:
        server: Server; its spawn pose is replaced.
        poses: Blocks of INIT of places whose robots neither see nor touch each other.
    """
    with ThreadPoolExecutor(len(poses)) as executor:
        yield ParallelPlayer(server, poses, executor)
