"""Faults that the server contains, and the signals that end its process.

A fault ends the work that raised it: a command, a request, a frame's channel, a robot. The client
gets a report, and the log a traceback the first time and then a line: a fault that a client can
cause at will must not fill the log with tracebacks.

SIGTERM and SIGINT end the process within a second in every state. Python runs signal handlers in
the main thread, between two bytecodes: a main thread that imports a library, waits for a lock or
writes to a full pipe delays them without limit. Here the interpreter's wake-up descriptor hands
each signal to a thread that does nothing else. This module imports only what the interpreter loads
in about a millisecond, so that signals are handled before the server's libraries are loaded.
"""

from __future__ import annotations

import logging
import os
import select
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple


def log_fault(log: logging.Logger, message: str, *args: object) -> None:
    """Log the exception that is being handled, at the first time with its traceback.

    Args:
        log: Logger of the module that contains the fault.
        message: The work that failed and the consequence, as a template of `logging`.
        args: Arguments of the template.
    """
    error = sys.exc_info()[1]
    assert error is not None, "to be called while an exception is handled"
    is_new = _record(error)
    log.error(message + ": %r", *args, error, exc_info=error if is_new else None)


# Of distinct faults; a program with more has other problems, and begins anew.
_MAX_FAULTS = 256

_lock = threading.Lock()
_logged: set[tuple[str, str, int]] = set()


def _record(error: BaseException) -> bool:
    """Record an exception by its type and origin; False if it was recorded before."""
    frames = traceback.extract_tb(error.__traceback__)
    origin = frames[-1] if frames else None
    key = (
        type(error).__qualname__,
        origin.filename if origin else "",
        (origin.lineno or 0) if origin else 0,
    )
    with _lock:
        if key in _logged:
            return False
        if len(_logged) >= _MAX_FAULTS:
            _logged.clear()
        _logged.add(key)
        return True


# The end is promised within 1 s. An orderly end takes 0.12 s on two cores; the rest of the second
# is for the last lines of the log, and for a call of a library that holds the interpreter's lock:
# 0.2 s at most were measured, while 600 000 triangles are loaded.
_GRACE_S = 0.7


class Termination:
    """Reaction of the process to signals that end it.

    The first signal begins an orderly end, where one is registered (`call_on_signal`), for which
    the process has `grace_s`. After that time, at a second signal, or where none is registered, the
    process ends at once. The exit status follows from the first signal: 0 after SIGTERM, 130 after
    SIGINT, which is also reported in a line on standard error.

    Args:
        exit_process: ends the process with a status.
        grace_s: time of an orderly end, seconds.
    """

    def __init__(
        self, exit_process: Callable[[int], object] = os._exit, grace_s: float = _GRACE_S
    ) -> None:
        self._exit_process = exit_process
        self._grace_s = grace_s
        self._lock = threading.Lock()
        self._actions = _END_AT_ONCE
        self.status = 0
        """Exit status by the first signal; 0 before."""

    @contextmanager
    def handle_signals(self) -> Iterator[None]:
        """Handle signals for the length of a block, in the main thread only."""
        reader, writer = os.pipe()
        # The interpreter's handler must never block; one byte in the pipe is as good as many.
        os.set_blocking(writer, False)
        previous_descriptor = signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        previous = {number: signal.signal(number, _ignore_signal) for number in _SIGNALS}
        watcher = threading.Thread(
            target=self._watch, args=(reader,), name="termination", daemon=True
        )
        watcher.start()
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)
            signal.set_wakeup_fd(previous_descriptor)
            os.close(writer)
            watcher.join()
            os.close(reader)

    @contextmanager
    def call_on_signal(
        self, stop: Callable[[], object], *, flush: Callable[[], object], note: str = ""
    ) -> Iterator[None]:
        """Begin an orderly end at the first signal, for the length of a block.

        Args:
            stop: begins the orderly end; called at most once, in another thread, returns at once.
            flush: writes the last lines of the log before the process ends at once; returns
                within a tenth of a second.
            note: added to the line that reports SIGINT.
        """
        with self._lock:
            self._actions = _Actions(stop, flush, note and f"; {note}")
        try:
            yield
        finally:
            with self._lock:
                self._actions = _END_AT_ONCE

    def _watch(self, signals: int) -> None:
        """Read signals from a descriptor until its other end is closed; end the process."""
        end_s: float | None = None
        while _wait_until(signals, end_s):
            numbers = os.read(signals, 1)
            if not numbers:
                return
            # The interpreter reports every signal that has a Python handler.
            if numbers[0] not in _SIGNALS:
                continue
            if end_s is None:
                self._set_status(signal.Signals(numbers[0]))
            if end_s is not None or not self._begin_stop():
                break
            end_s = time.monotonic() + self._grace_s
        self._actions.flush()
        self._exit_process(self.status)

    def _set_status(self, number: signal.Signals) -> None:
        self.status = _STATUS_OF_SIGNAL[number]
        # A pipe that nobody reads must not delay the end: select reports room for a short line.
        if self.status and _has_room(_STDERR):
            # On a terminal in place of a line of progress.
            start = "\r\x1b[K" if os.isatty(_STDERR) else ""
            line = f"{start}catoptra-server: interrupted{self._actions.note}\n"
            os.write(_STDERR, line.encode())

    def _begin_stop(self) -> bool:
        """Begin the orderly end, and return whether there is one."""
        # Under the lock, so that the loop which the function calls is not closed meanwhile.
        with self._lock:
            if self._actions.stop is None:
                return False
            self._actions.stop()
            return True


_SIGNALS = (signal.SIGTERM, signal.SIGINT)
# Ctrl-C has the status that shells give it; SIGTERM is how service managers end a healthy server.
_STATUS_OF_SIGNAL = {signal.SIGTERM: 0, signal.SIGINT: 130}
_STDERR = 2


class _Actions(NamedTuple):
    """Reactions to signals, at one stage of the process."""

    stop: Callable[[], object] | None
    """Begins an orderly end; None: the process ends at once."""
    flush: Callable[[], object]
    """Called before the process ends at once."""
    note: str = ""
    """Added to the line that reports SIGINT."""


_END_AT_ONCE = _Actions(stop=None, flush=lambda: None)


def _has_room(descriptor: int) -> bool:
    """Whether a short line can be written without a wait; False for a closed descriptor."""
    try:
        return bool(select.select([], [descriptor], [], 0.0)[1])
    except (OSError, ValueError):
        return False


def _wait_until(descriptor: int, end_s: float | None) -> bool:
    """Whether a descriptor becomes readable before a time of the monotonic clock."""
    timeout_s = None if end_s is None else max(end_s - time.monotonic(), 0.0)
    return bool(select.select([descriptor], [], [], timeout_s)[0])


def _ignore_signal(number: int, frame: object) -> None:
    """Do nothing: the wake-up descriptor reports the signal."""
