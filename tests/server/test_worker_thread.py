"""A thread's start can be awaited, its failure is told, its end is waited for."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

import pytest

from catoptra_server.worker_thread import WorkerThread
from helpers.loopback import run_scenario


class Work:
    """Runs until stopped; fails before or after it is ready, if told to."""

    def __init__(self, *, fails: str = "") -> None:
        self._fails = fails
        self._stopped = threading.Event()
        self.has_ended = False

    def run(self, ready: Callable[[], None]) -> None:
        if self._fails == "before":
            raise ValueError("broken")
        ready()
        if self._fails == "after":
            raise ValueError("broken")
        self._stopped.wait()
        self.has_ended = True

    def stop(self) -> None:
        self._stopped.set()


def test_worker_when_stopped_has_ended() -> None:
    async def scene() -> None:
        work = Work()
        worker = WorkerThread("w", work.run, stop=work.stop, on_failure=lambda: None)
        await worker.start()
        await worker.stop()
        assert work.has_ended

    run_scenario(scene())


def test_worker_when_it_cannot_start_says_why() -> None:
    async def scene() -> None:
        work = Work(fails="before")
        worker = WorkerThread("w", work.run, stop=work.stop, on_failure=lambda: None)
        with pytest.raises(ValueError, match="broken"):
            await worker.start()

    run_scenario(scene())


def test_worker_when_it_fails_later_tells_at_once_and_when_stopped() -> None:
    async def scene() -> None:
        told = asyncio.Event()
        work = Work(fails="after")
        worker = WorkerThread("w", work.run, stop=work.stop, on_failure=told.set)
        await worker.start()
        await told.wait()
        with pytest.raises(ValueError, match="broken"):
            await worker.stop()

    run_scenario(scene())
