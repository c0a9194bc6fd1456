"""Worker threads: start and end are awaited, a failure is reported."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections.abc import Callable

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.runtime.worker_thread import (
    ThreadFailedError,
    WorkerThread,
    lower_thread_priority,
)
from helpers.loopback import DEADLINE_S


class Work:
    """Work that runs until stopped, or fails before or after it is ready, by a bug or in words."""

    def __init__(self, *, fails: str = "") -> None:
        self._fails = fails
        self._stopped = threading.Event()
        self.has_ended = False

    def run(self, ready: Callable[[], None]) -> None:
        if self._fails == "before":
            raise ValueError("broken")
        if self._fails == "in words":
            raise DomainError("no renderer")
        ready()
        if self._fails == "after":
            raise ValueError("broken")
        assert self._stopped.wait(DEADLINE_S), "the work was not stopped"
        self.has_ended = True

    def stop(self) -> None:
        self._stopped.set()


async def test_worker_when_stopped_has_ended() -> None:
    work = Work()
    worker = WorkerThread("w", work.run, stop=work.stop, on_failure=lambda: None)
    await worker.start()
    await worker.stop()
    assert work.has_ended


@pytest.mark.parametrize(
    ("fails", "error", "reason"),
    [
        ("before", ThreadFailedError, "the w thread failed: ValueError: broken"),
        ("in words", DomainError, "no renderer"),
    ],
)
async def test_worker_that_cannot_start_raises_the_reason(
    fails: str, error: type[Exception], reason: str
) -> None:
    work = Work(fails=fails)
    worker = WorkerThread("w", work.run, stop=work.stop, on_failure=lambda: None)
    with pytest.raises(error, match=reason):
        await worker.start()


async def test_worker_when_it_fails_later_reports_at_once_and_when_stopped(
    caplog: pytest.LogCaptureFixture,
) -> None:
    failed = asyncio.Event()
    work = Work(fails="after")
    worker = WorkerThread("w", work.run, stop=work.stop, on_failure=failed.set)
    await worker.start()
    await failed.wait()
    with pytest.raises(ThreadFailedError, match="the w thread failed: ValueError: broken"):
        await worker.stop()
    assert "the w thread failed: the server ends" in caplog.text
    assert "ValueError: broken" in caplog.text


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has a niceness of threads")
def test_priority_is_that_of_one_thread_and_those_that_it_starts() -> None:
    found = list[int]()

    def record() -> None:
        found.append(os.getpriority(os.PRIO_PROCESS, threading.get_native_id()))

    def lower() -> None:
        lower_thread_priority(before + 1)
        record()
        started = threading.Thread(target=record)
        started.start()
        started.join()

    record()
    before = found[0]
    thread = threading.Thread(target=lower)
    thread.start()
    thread.join()
    record()
    assert found == [before, before + 1, before + 1, before]
