"""The server's log on standard error: limited, escaped, and never waited for.

A thread writes the lines, and it alone waits for standard error: a pipe that nobody reads blocks
every writer once its 64 KiB are full. The other threads append to a bounded queue; lines beyond the
bound are dropped and counted.

Lines that repeat are counted in place of written. A client can cause a line at will, by connecting
or by a wrong command, and the lines of the others must remain readable. A limit counts per logger,
level and template, such as 'controller %s connected', within a second from its first line.

One record is one line, with continuation lines indented. Names and messages come from clients, so
their control characters are escaped: a terminal that shows the log obeys escape sequences, and a
line break could begin a forged line.
"""

from __future__ import annotations

import logging
import math
import os
import select
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass

log = logging.getLogger(__name__)

_STDERR = 2


@contextmanager
def write_log(level: int) -> Iterator[LogWriter]:
    """Write the log of the process to standard error, for the length of a block.

    Warnings and exceptions that Python itself would print become lines of the log, because a print
    waits for standard error.

    Args:
        level: least level that is written.
    """
    writer, root = LogWriter(_STDERR), logging.getLogger()
    previous = root.level, threading.excepthook, sys.unraisablehook
    root.addHandler(writer)
    root.setLevel(level)
    logging.captureWarnings(True)
    threading.excepthook, sys.unraisablehook = _log_thread_exception, _log_unraisable
    try:
        yield writer
    finally:
        logging.captureWarnings(False)
        threading.excepthook, sys.unraisablehook = previous[1:]
        root.setLevel(previous[0])
        root.removeHandler(writer)
        writer.close()


def _log_thread_exception(arguments: threading.ExceptHookArgs) -> None:
    name = arguments.thread.name if arguments.thread else "a finished thread"
    log.error("exception in thread %s", name, exc_info=arguments.exc_value)


def _log_unraisable(arguments: sys.UnraisableHookArgs) -> None:
    message = arguments.err_msg or "exception ignored in"
    log.error("%s: %r", message, arguments.object, exc_info=arguments.exc_value)


# Forty thousand lines of usual length: a pipe that is read again after some minutes misses no line.
_MAX_QUEUED_BYTES = 4 * 1024 * 1024
# Of an end without a signal; after a signal the process ends earlier (`faults`).
_CLOSE_TIMEOUT_S = 2.0
# Lines that are written at once; a pipe takes 64 KiB.
_MAX_WRITTEN_LINES = 256


class LogWriter(logging.Handler):
    """A handler that writes records to a descriptor, and never waits for the descriptor.

    Args:
        descriptor: open file that receives UTF-8.
    """

    def __init__(self, descriptor: int) -> None:
        super().__init__()
        self.setFormatter(_LogFormatter())
        self._descriptor = descriptor
        # Reentrant, as Condition's own lock is: a finalizer may log while a line is appended.
        self._changed = threading.Condition()
        self._limiter = LineLimiter()
        self._queue: deque[bytes] = deque()
        self._num_bytes = 0
        self._num_dropped = 0
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="log", daemon=True)
        self._thread.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record, or count the record where its like are frequent."""
        try:
            if self._admit(record):
                self._append(self.format(record))
        # Arguments that do not fit the template, or whose text raises: a bug in the server, which
        # must not reach the caller.
        except Exception:
            where = f"{record.pathname}:{record.lineno}"
            self.write_line(f"{where}: the arguments of {record.msg!r} cannot be logged")

    def write_line(self, line: str) -> None:
        """Queue a line without time and level."""
        self._append(_escape_controls(line))

    def flush(self, timeout_s: float = 0.0) -> None:
        """Wait until all lines are written, for a time at most.

        Args:
            timeout_s: limit of the wait, seconds.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._num_bytes == 0, timeout_s)

    def close(self) -> None:
        """Write the queued lines, within a bounded time, and end the thread."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join(_CLOSE_TIMEOUT_S)
        super().close()

    def _admit(self, record: logging.LogRecord) -> bool:
        # Wire traffic, logged at DEBUG on request, is complete.
        if record.levelno <= logging.DEBUG:
            return True
        with self._changed:
            return self._limiter.admit(record, time.monotonic())

    def _append(self, line: str) -> None:
        data = line.encode("utf-8", "backslashreplace") + b"\n"
        with self._changed:
            if self._num_bytes + len(data) > _MAX_QUEUED_BYTES:
                self._num_dropped += 1
                return
            self._queue.append(data)
            self._num_bytes += len(data)
            self._changed.notify_all()

    def _run(self) -> None:
        """Write lines until the handler is closed and all are written."""
        while data := self._wait_for_data():
            _write_all(self._descriptor, data)
            with self._changed:
                self._num_bytes -= len(data)
                self._changed.notify_all()

    def _wait_for_data(self) -> bytes:
        """Lines to be written; empty at the end."""
        with self._changed:
            while True:
                self._append_counts()
                if self._queue:
                    return self._pop_lines()
                if self._is_closed:
                    return b""
                self._changed.wait(self._limiter.remaining_s(time.monotonic()))

    def _append_counts(self) -> None:
        """Queue the counts of suppressed and of dropped lines that are due."""
        end_s = math.inf if self._is_closed else time.monotonic()
        for record in self._limiter.end_windows(end_s):
            self._append(self.format(record))
        if self._num_dropped and self._num_bytes < _MAX_QUEUED_BYTES // 2:
            num, self._num_dropped = self._num_dropped, 0
            self.write_line(f"{num} lines of the log dropped: standard error is read too slowly")

    def _pop_lines(self) -> bytes:
        num = min(len(self._queue), _MAX_WRITTEN_LINES)
        return b"".join(self._queue.popleft() for _ in range(num))


def _write_all(descriptor: int, data: bytes) -> None:
    """Write bytes; without effect where nothing reads any more."""
    rest = memoryview(data)
    while rest:
        try:
            # A wait of its own: another process may have made the shared pipe non-blocking.
            select.select([], [descriptor], [])
            rest = rest[os.write(descriptor, rest[: select.PIPE_BUF]) :]
        except BlockingIOError:
            continue
        except OSError:
            # Closed: there is no place left to report this.
            return


WINDOW_S = 1.0
# Different lines of one template per window. Sixteen robots that connect at once log all their
# lines; 185 connections in a second log 20 and a count.
MAX_LINES = 20

# Logger, level and template.
_Kind = tuple[str, int, str]


class LineLimiter:
    """Count of the lines of each kind; not safe for threads."""

    def __init__(self) -> None:
        # In the order of their ends: all windows have one length.
        self._windows: dict[_Kind, _Window] = {}

    def admit(self, record: logging.LogRecord, now_s: float) -> bool:
        """Whether to write a record; counts the record if not.

        Args:
            record: the record.
            now_s: time of a clock that never goes back, seconds.
        """
        kind = (record.name, record.levelno, str(record.msg))
        window = self._windows.setdefault(kind, _Window(now_s + WINDOW_S))
        line = record.getMessage()
        if line in window.repetitions:
            window.repetitions[line] += 1
        elif len(window.repetitions) < MAX_LINES:
            window.repetitions[line] = 0
            return True
        else:
            window.num_suppressed += 1
        return False

    def remaining_s(self, now_s: float) -> float | None:
        """Time until the next window ends, seconds; None without windows."""
        end_s = self._next_end_s
        return None if end_s is None else max(end_s - now_s, 0.0)

    def end_windows(self, now_s: float) -> list[logging.LogRecord]:
        """End the windows whose time is over, and return the counts of their lines."""
        counts: list[logging.LogRecord] = []
        while (end_s := self._next_end_s) is not None and end_s <= now_s:
            kind = next(iter(self._windows))
            counts += _count_lines(kind, self._windows.pop(kind))
        return counts

    @property
    def _next_end_s(self) -> float | None:
        return next((window.end_s for window in self._windows.values()), None)


@dataclass(slots=True)
class _Window:
    """Lines of one kind since the first of them."""

    end_s: float
    repetitions: dict[str, int] = field(default_factory=dict)
    """Number of repetitions of each line that was written."""
    num_suppressed: int = 0
    """Number of lines above the limit."""


def _count_lines(kind: _Kind, window: _Window) -> Iterator[logging.LogRecord]:
    name, level, template = kind
    for line, num in window.repetitions.items():
        if num:
            times = "once" if num == 1 else f"{num} times"
            first = line.partition("\n")[0]
            yield _make_record(name, level, f"{first} (repeated {times})")
    if window.num_suppressed:
        text = f"{window.num_suppressed} more '{template}' lines in the last second"
        yield _make_record(name, level, text)


def _make_record(name: str, level: int, text: str) -> logging.LogRecord:
    return logging.LogRecord(name, level, "", 0, text, None, None)


class _LogFormatter(logging.Formatter):
    """Time, level, logger and message of a record; its traceback in indented lines."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(levelname)-7s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Text of a record without control characters, and without the last line break."""
        return _escape_controls(super().format(record)).replace("\n", _CONTINUATION)


# C0 without the line break, DEL and C1; then line separators and marks of the writing direction,
# which change the order of the characters in a terminal.
_CONTROL_CODES = (
    *(code for code in range(0x20) if code != 0x0A),
    *range(0x7F, 0xA0),
    *(0x200E, 0x200F, 0x2028, 0x2029),
    *range(0x202A, 0x202F),
    *range(0x2066, 0x206A),
)
_ESCAPES = {code: f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" for code in _CONTROL_CODES}
_CONTINUATION = "\n    "


def _escape_controls(text: str) -> str:
    r"""Text with control characters other than the line break escaped, such as \x1b."""
    return text.translate(_ESCAPES)
