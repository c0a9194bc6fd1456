"""Shards drawn by processes of this machine, each with one thread and a warm renderer.

Processes are spawned, since OpenGL contexts and threads do not survive a fork. A worker that dies
loses a shard: another worker draws that again, a bounded number of times. Workers end with
the driver: the next message fails.
"""

from __future__ import annotations

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.interrupts import start_without_interrupts
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.shards import ShardArtist, ShardJob, ShardRecord, start_artist

_MAX_ATTEMPTS = 3
"""Times that a shard is drawn whose worker dies."""
# Time for a worker to end after the pipe is closed; a sample takes less.
_JOIN_S = 5.0
# Called when a sample is begun (index, True), and with (number, False) for samples lost.
_CountSamples = Callable[[int, bool], None]


class DatasetInterruptedError(CatoptraError):
    """The user has ended the drawing of a data set."""


class LocalWorkers:
    """Processes that draw the shards of one data set."""

    def __init__(
        self,
        job: ShardJob,
        num_workers: int,
        *,
        count: _CountSamples = lambda number, is_begun: None,
        interrupt: Connection | None = None,
    ) -> None:
        """Prepare; `draw` starts the processes.

        Args:
            job: The data set.
            num_workers: Number of processes.
            count: Called for every sample.
            interrupt: Readable once the user wants an end.
        """
        self._job = job
        self._num_workers = num_workers
        self._count = count
        self._interrupt = interrupt
        self._workers: list[_Worker] = []
        self._queue: deque[int] = deque()
        self._attempts: dict[int, int] = {}
        self._num_failed_starts = 0

    def draw(self, shards: Sequence[int]) -> Iterator[ShardRecord]:
        """Draw shards, and yield the record of each when finished, in any order.

        Raises:
            DatasetInterruptedError: The user wants an end.
            CatoptraError: A sample cannot be drawn, a shard not written, or its workers die.
        """
        self._queue = deque(shards)
        num_left = len(shards)
        try:
            while num_left:
                self._start_workers(min(self._num_workers, num_left))
                for record in self._serve_events():
                    num_left -= 1
                    yield record
        finally:
            self._stop_workers()

    @property
    def pids(self) -> list[int]:
        """Processes, for tests that kill one."""
        return [worker.process.pid for worker in self._workers]

    def _start_workers(self, number: int) -> None:
        while len(self._workers) < number:
            # Spawned: a fork has this process's NumPy, but no threads and no OpenGL context.
            context = multiprocessing.get_context("spawn")
            own, others = context.Pipe()
            process = context.Process(target=_run_worker, args=(self._job, others), daemon=True)
            # Ctrl-C reaches all processes of a terminal; the driver decides.
            with start_without_interrupts():
                process.start()
            # Closed here, so that the end of the process closes the pipe.
            others.close()
            self._workers.append(_Worker(process, own))

    def _serve_events(self) -> Iterator[ShardRecord]:
        """Wait for words or deaths of workers, and yield finished shards."""
        sources: list[Any] = [worker.connection for worker in self._workers]
        sources += [worker.process.sentinel for worker in self._workers]
        ready = wait([*sources, self._interrupt] if self._interrupt else sources)
        if self._interrupt in ready:
            raise DatasetInterruptedError("interrupted")
        for worker in [*self._workers]:
            # A death is known by the closed pipe, after the last word.
            if worker.connection in ready or worker.process.sentinel in ready:
                yield from self._read_words(worker)

    def _read_words(self, worker: _Worker) -> Iterator[ShardRecord]:
        try:
            while worker.connection.poll():
                word = worker.connection.recv()
                if isinstance(word, ShardRecord):
                    yield word
                self._note(worker, word)
        except (EOFError, ConnectionResetError, BrokenPipeError):
            self._bury(worker)

    def _note(self, worker: _Worker, word: object) -> None:
        match word:
            case _SampleStarted(index):
                worker.sample = index
                worker.num_begun += 1
                self._count(1, True)
            case _WorkerFailed(reason):
                raise CatoptraError(reason)
            case _WorkerReady() | ShardRecord():
                worker.shard, worker.sample, worker.num_begun = None, None, 0
                if self._queue:
                    worker.shard = self._queue.popleft()
                    worker.connection.send(worker.shard)

    def _bury(self, worker: _Worker) -> None:
        """Take the shard of a dead worker back."""
        worker.process.join(_JOIN_S)
        self._workers.remove(worker)
        worker.connection.close()
        end = _describe_exit(worker.process.exitcode)
        if worker.shard is None:
            self._num_failed_starts += worker.sample is None
            if self._num_failed_starts >= _MAX_ATTEMPTS:
                raise CatoptraError(f"workers end before their first sample: {end}")
            return
        attempts = self._attempts[worker.shard] = self._attempts.get(worker.shard, 0) + 1
        self._count(worker.num_begun, False)
        if attempts >= _MAX_ATTEMPTS:
            at = "before its first sample" if worker.sample is None else f"sample {worker.sample}"
            raise CatoptraError(
                f"shard {worker.shard}: {attempts} workers have ended while they drew it, the last "
                f"one at {at}: {end}"
            )
        self._queue.appendleft(worker.shard)

    def _stop_workers(self) -> None:
        for worker in self._workers:
            worker.connection.close()
            worker.process.terminate()
        for worker in self._workers:
            worker.process.join(_JOIN_S)
        self._workers.clear()


@dataclass(slots=True, eq=False)
class _Worker:
    process: Any  # multiprocessing.context.SpawnProcess, which has no public name
    connection: Connection
    shard: int | None = None
    sample: int | None = None
    num_begun: int = 0


# Words of workers to their driver.
@dataclass(frozen=True, slots=True)
class _WorkerReady:
    """The worker has loaded the recipe."""


@dataclass(frozen=True, slots=True)
class _SampleStarted:
    """The worker begins a sample."""

    index: int


@dataclass(frozen=True, slots=True)
class _WorkerFailed:
    """The worker cannot go on; another one could not either."""

    reason: str


def _run_worker(job: ShardJob, connection: Connection) -> None:
    """Main function of a worker process: draw the shards that the driver names."""
    try:
        artist = start_artist(job)
        connection.send(_WorkerReady())
        _draw_shards(artist, Path(job.folder), connection)
    except CatoptraError as error:
        _send_last_word(connection, _WorkerFailed(str(error)))
    # The driver is gone, or wants no more.
    except (EOFError, OSError):
        pass


def _draw_shards(artist: ShardArtist, folder: Path, connection: Connection) -> None:
    def report(index: int) -> None:
        try:
            connection.send(_SampleStarted(index))
        except OSError:
            # Nobody waits for this shard. No OSError, which would read as one of the disk.
            raise SystemExit from None

    try:
        while True:
            connection.send(artist.draw_shard(folder, connection.recv(), report))
    finally:
        artist.close()


def _send_last_word(connection: Connection, word: _WorkerFailed) -> None:
    try:
        connection.send(word)
    except OSError:
        pass


def _describe_exit(code: int | None) -> str:
    if code is None or code >= 0:
        return f"exit status {code}"
    name = signal.Signals(-code).name
    hint = ", as when memory is short" if -code == signal.SIGKILL else ""
    return f"ended by {name}{hint}"
