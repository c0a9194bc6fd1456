"""Faults have one traceback each; signals end the process in an orderly way, then at once."""

from __future__ import annotations

import logging
import os
import queue
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from catoptra_server.runtime.faults import Termination, log_fault

log = logging.getLogger("fault")


def fail(number: int) -> None:
    try:
        raise ZeroDivisionError(number)
    except ZeroDivisionError:
        log_fault(log, "robot %d failed", number)


def test_fault_has_its_traceback_once(caplog: pytest.LogCaptureFixture) -> None:
    for number in range(3):
        fail(number)
    assert [bool(record.exc_info) for record in caplog.records] == [True, False, False]
    messages = [record.getMessage() for record in caplog.records]
    assert messages[2] == "robot 2 failed: ZeroDivisionError(2)"


def test_fault_of_another_origin_has_a_traceback_of_its_own(
    caplog: pytest.LogCaptureFixture,
) -> None:
    for make in (lambda: [][0], lambda: [][1]):  # two origins, on one line each
        try:
            make()
        except IndexError:
            log_fault(log, "no element")
    fail(4)
    assert sum(bool(record.exc_info) for record in caplog.records) >= 1


DEADLINE_S = 20.0
FOREVER_S = 1000.0


class Exit:
    """The end of the process, recorded in place of ending the tests."""

    def __init__(self) -> None:
        self._statuses: queue.SimpleQueue[int] = queue.SimpleQueue()

    def __call__(self, status: int) -> None:
        self._statuses.put(status)

    def wait(self) -> int:
        """Exit status of the process."""
        return self._statuses.get(timeout=DEADLINE_S)

    @property
    def is_requested(self) -> bool:
        return not self._statuses.empty()


@contextmanager
def stop_on_signal(termination: Termination) -> Iterator[threading.Event]:
    """Handle signals with an orderly end, the event, that does not come."""
    stopping = threading.Event()
    with termination.handle_signals(), termination.call_on_signal(stopping.set, flush=lambda: None):
        yield stopping


@pytest.mark.parametrize(
    ("number", "status", "line"),
    [(signal.SIGTERM, 0, ""), (signal.SIGINT, 130, "catoptra-server: interrupted\n")],
)
def test_signal_before_anything_runs_ends_the_process_at_once(
    capfd: pytest.CaptureFixture[str], number: signal.Signals, status: int, line: str
) -> None:
    exit_process = Exit()
    with Termination(exit_process, FOREVER_S).handle_signals():
        signal.raise_signal(number)
        assert exit_process.wait() == status
    assert capfd.readouterr().err == line


def test_status_is_that_of_the_first_signal() -> None:
    exit_process = Exit()
    termination = Termination(exit_process, FOREVER_S)
    with stop_on_signal(termination) as stopping:
        signal.raise_signal(signal.SIGINT)
        assert stopping.wait(DEADLINE_S)
        signal.raise_signal(signal.SIGTERM)
        assert exit_process.wait() == 130
    assert termination.status == 130


def test_interrupt_does_not_wait_for_a_standard_error_that_nobody_reads() -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    with suppress(BlockingIOError):
        while True:
            os.write(writer, bytes(4096))
    os.set_blocking(writer, True)
    kept = os.dup(2)
    os.dup2(writer, 2)
    try:
        exit_process = Exit()
        with Termination(exit_process, FOREVER_S).handle_signals():
            signal.raise_signal(signal.SIGINT)
            assert exit_process.wait() == 130
    finally:
        os.dup2(kept, 2)
        for descriptor in (kept, reader, writer):
            os.close(descriptor)


def test_first_signal_begins_an_orderly_end() -> None:
    exit_process = Exit()
    with stop_on_signal(Termination(exit_process, FOREVER_S)) as stopping:
        signal.raise_signal(signal.SIGTERM)
        assert stopping.wait(DEADLINE_S)
    assert not exit_process.is_requested


def test_orderly_end_that_takes_too_long_is_cut_short_after_the_log() -> None:
    exit_process, flushed = Exit(), threading.Event()
    termination = Termination(exit_process, grace_s=0.01)
    with termination.handle_signals(), termination.call_on_signal(lambda: None, flush=flushed.set):
        signal.raise_signal(signal.SIGTERM)
        assert exit_process.wait() == 0
        assert flushed.is_set()


def test_second_signal_ends_the_process_at_once() -> None:
    exit_process = Exit()
    with stop_on_signal(Termination(exit_process, FOREVER_S)) as stopping:
        signal.raise_signal(signal.SIGTERM)
        assert stopping.wait(DEADLINE_S)
        signal.raise_signal(signal.SIGINT)
        assert exit_process.wait() == 0


def test_signal_after_the_orderly_end_has_finished_ends_the_process_at_once() -> None:
    exit_process = Exit()
    termination = Termination(exit_process, FOREVER_S)
    with termination.handle_signals():
        with termination.call_on_signal(lambda: None, flush=lambda: None):
            pass
        signal.raise_signal(signal.SIGTERM)
        assert exit_process.wait() == 0


def test_signal_ends_a_process_whose_main_thread_waits() -> None:
    statuses, status = os.pipe()
    termination = Termination(lambda number: os.write(status, bytes([number])), FOREVER_S)
    with termination.handle_signals():
        sender = threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGTERM))
        sender.start()
        # Python resumes this call after each signal: no handler of the main thread ends it.
        assert os.read(statuses, 1) == b"\x00"
        sender.join(DEADLINE_S)
    os.close(statuses)
    os.close(status)


def test_other_signals_end_nothing() -> None:
    exit_process, received = Exit(), threading.Event()
    previous = signal.signal(signal.SIGUSR1, lambda *_: received.set())
    with stop_on_signal(Termination(exit_process, FOREVER_S)) as stopping:
        signal.raise_signal(signal.SIGUSR1)
        assert received.wait(DEADLINE_S)
        signal.raise_signal(signal.SIGTERM)
        assert stopping.wait(DEADLINE_S)
        assert not exit_process.is_requested
    signal.signal(signal.SIGUSR1, previous)


def test_handlers_are_restored() -> None:
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with Termination(Exit()).handle_signals():
        assert signal.getsignal(signal.SIGTERM) != before[0]
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before
    assert signal.set_wakeup_fd(-1) == -1
