"""The log: no client can flood, break or forge its lines, and an unread pipe blocks nobody."""

from __future__ import annotations

import gc
import logging
import os
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from catoptra_server.runtime import logs as module
from catoptra_server.runtime.logs import MAX_LINES, WINDOW_S, LineLimiter, LogWriter, write_log
from helpers.deadline import Deadline


def make_record(message: str, *args: object, level: int = logging.INFO) -> logging.LogRecord:
    return logging.LogRecord("tcp", level, "", 0, message, args, None)


def end_window(limiter: LineLimiter, now_s: float = WINDOW_S) -> list[str]:
    """Counts after the end of a window that began at 0."""
    return [record.getMessage() for record in limiter.end_windows(now_s)]


def test_identical_lines_are_written_once_and_counted() -> None:
    limiter = LineLimiter()
    admitted = [limiter.admit(make_record("%s is full", "queue"), 0.0) for _ in range(154)]
    assert sum(admitted) == 1
    assert end_window(limiter) == ["queue is full (repeated 153 times)"]


def test_lines_of_one_template_are_limited_and_counted() -> None:
    limiter = LineLimiter()
    admitted = [limiter.admit(make_record("%d connected", i), 0.0) for i in range(185)]
    assert sum(admitted) == MAX_LINES
    assert end_window(limiter) == [
        f"{185 - MAX_LINES} more '%d connected' lines in the last second"
    ]


def test_lines_of_another_template_or_level_are_independent() -> None:
    limiter = LineLimiter()
    for i in range(MAX_LINES):
        assert limiter.admit(make_record("%d connected", i), 0.0)
    assert limiter.admit(make_record("%d disconnected", 1), 0.0)
    assert limiter.admit(make_record("%d connected", 99, level=logging.WARNING), 0.0)


def test_lines_in_the_next_window_are_written_again() -> None:
    limiter = LineLimiter()
    assert limiter.admit(make_record("full"), 0.0)
    assert not limiter.admit(make_record("full"), 0.5)
    assert end_window(limiter, 0.99) == []
    assert end_window(limiter) == ["full (repeated once)"]
    assert limiter.admit(make_record("full"), WINDOW_S)


def test_window_without_suppressed_lines_ends_silently() -> None:
    limiter = LineLimiter()
    assert limiter.admit(make_record("full"), 0.0)
    assert end_window(limiter) == []


def test_remaining_time_is_that_of_the_oldest_window() -> None:
    limiter = LineLimiter()
    assert limiter.remaining_s(0.0) is None
    limiter.admit(make_record("one"), 0.0)
    limiter.admit(make_record("two"), 0.5)
    assert limiter.remaining_s(0.75) == WINDOW_S - 0.75
    assert limiter.remaining_s(2.0) == 0.0


def test_count_of_a_template_with_percent_signs_can_be_formatted() -> None:
    limiter = LineLimiter()
    for i in range(MAX_LINES + 1):
        limiter.admit(make_record("%d%% of %s", i, "all"), 0.0)
    assert end_window(limiter) == ["1 more '%d%% of %s' lines in the last second"]


def test_repetition_of_several_lines_is_counted_by_the_first() -> None:
    limiter = LineLimiter()
    for _ in range(3):
        limiter.admit(make_record("effects:\nfog\nnoise"), 0.0)
    assert end_window(limiter) == ["effects: (repeated 2 times)"]


DEADLINE_S = 20.0


class Pipe:
    """A pipe as standard error, and what was read from it."""

    def __init__(self) -> None:
        self._reader, self.writer = os.pipe()
        self.text = ""

    def read_until(self, part: str) -> None:
        """Read until a text occurs."""
        deadline = Deadline(f"{part!r} in the log", DEADLINE_S)
        while part not in self.text:
            deadline.check()
            self.text += os.read(self._reader, 65536).decode()

    def close_reader(self) -> None:
        """Close the end that reads."""
        if self._reader >= 0:
            os.close(self._reader)
        self._reader = -1

    def close(self) -> None:
        """Close both ends."""
        self.close_reader()
        os.close(self.writer)


@pytest.fixture
def pipe() -> Iterator[Pipe]:
    pipe = Pipe()
    yield pipe
    pipe.close()


@pytest.fixture
def logger() -> Iterator[logging.Logger]:
    """A logger of its own, whose handlers are removed."""
    logger = logging.getLogger("test-of-log-writer")
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    yield logger
    logger.handlers.clear()


@pytest.fixture
def writer(
    pipe: Pipe, logger: logging.Logger, monkeypatch: pytest.MonkeyPatch
) -> Iterator[LogWriter]:
    """A writer to the pipe, on the logger; tests that leave the pipe full do not wait for it."""
    monkeypatch.setattr(module, "_CLOSE_TIMEOUT_S", 0.01)
    writer = LogWriter(pipe.writer)
    logger.addHandler(writer)
    yield writer
    writer.close()


@pytest.mark.parametrize(
    ("text", "escaped"),
    [
        ("Robot-1 \u00e9\u4e16", "Robot-1 \u00e9\u4e16"),
        ("\x1b[2J", r"\x1b[2J"),
        ("\x00\t\r\x7f\x9b", r"\x00\x09\x0d\x7f\x9b"),
        ("\u2028\u202e\u2066\u200f", r"\u2028\u202e\u2066\u200f"),
    ],
)
def test_control_characters_are_escaped(
    pipe: Pipe, writer: LogWriter, text: str, escaped: str
) -> None:
    writer.write_line(text)
    pipe.read_until("\n")
    assert pipe.text == escaped + "\n"


def test_line_states_level_logger_and_message(pipe: Pipe, writer: LogWriter) -> None:
    writer.handle(make_record("robot %s is in the world", "R\x1b"))
    pipe.read_until(" INFO    tcp: robot R\\x1b is in the world\n")


def test_line_break_in_a_name_begins_no_line_of_its_own(pipe: Pipe, writer: LogWriter) -> None:
    writer.handle(make_record("robot %s", "R\n2026-01-01 INFO forged"))
    pipe.read_until("\n    2026-01-01 INFO forged\n")


def test_traceback_is_indented_and_escaped(pipe: Pipe, writer: LogWriter) -> None:
    record = make_record("failed")
    try:
        raise ValueError("\x1b]0;title")
    except ValueError:
        record.exc_info = sys.exc_info()
    writer.handle(record)
    pipe.read_until("title\n")
    first, *rest = pipe.text.splitlines()
    assert first.endswith("tcp: failed")
    assert rest[0] == "    Traceback (most recent call last):"
    assert rest[-1] == r"    ValueError: \x1b]0;title"


def fill(logger: logging.Logger) -> None:
    """Log more than a pipe and the queue take, at a level without limit."""
    for _ in range(70):
        logger.debug("x" * 65536)


def test_lines_are_written_in_order(pipe: Pipe, logger: logging.Logger, writer: LogWriter) -> None:
    for i in range(1000):
        logger.debug("line %d", i)
    writer.write_line("the end")
    pipe.read_until("the end\n")
    lines = pipe.text.splitlines()
    assert [line.rpartition(": ")[2] for line in lines[:-1]] == [f"line {i}" for i in range(1000)]


def test_unread_pipe_blocks_no_caller_and_dropped_lines_are_counted(
    pipe: Pipe, logger: logging.Logger, writer: LogWriter
) -> None:
    caller = threading.Thread(target=fill, args=(logger,), daemon=True)
    caller.start()
    caller.join(DEADLINE_S)
    assert not caller.is_alive(), "a caller is blocked"
    pipe.read_until("lines of the log dropped: standard error is read too slowly\n")
    logger.debug("read again")
    pipe.read_until("read again")


def test_close_with_an_unread_pipe_returns(
    pipe: Pipe, logger: logging.Logger, writer: LogWriter
) -> None:
    fill(logger)
    start_s = time.monotonic()
    writer.flush(0.01)
    writer.close()
    assert time.monotonic() - start_s < DEADLINE_S


def test_repeated_lines_are_counted_at_the_end_too(
    pipe: Pipe, logger: logging.Logger, writer: LogWriter
) -> None:
    for i in range(185):
        logger.info("controller %s connected", i)
        logger.warning("full")
    writer.close()
    pipe.read_until("full (repeated 184 times)")
    pipe.read_until("165 more 'controller %s connected' lines in the last second\n")
    assert pipe.text.count("connected\n") == 20


def test_count_of_repeated_lines_follows_without_another_line(
    pipe: Pipe, logger: logging.Logger, writer: LogWriter
) -> None:
    logger.info("full")
    logger.info("full")
    pipe.read_until("full (repeated once)\n")


def test_wire_traffic_is_not_limited(pipe: Pipe, logger: logging.Logger, writer: LogWriter) -> None:
    for _ in range(100):
        logger.debug("same")
    writer.close()
    pipe.read_until("same")
    writer.flush()
    assert pipe.text.count("same\n") == 100


def test_non_blocking_pipe_receives_all(
    pipe: Pipe, logger: logging.Logger, writer: LogWriter
) -> None:
    os.set_blocking(pipe.writer, False)
    for _ in range(10):
        logger.debug("x" * 65536)
    writer.write_line("the end")
    pipe.read_until("the end\n")
    assert pipe.text.count("x") == 10 * 65536


def test_closed_pipe_is_no_error(pipe: Pipe, logger: logging.Logger, writer: LogWriter) -> None:
    pipe.close_reader()
    logger.info("lost")
    writer.flush(DEADLINE_S)
    writer.close()
    assert not writer._thread.is_alive()


def test_record_with_wrong_arguments_is_reported_with_its_place(
    pipe: Pipe, writer: LogWriter
) -> None:
    # Not through a logger: pytest's own handler would raise the error.
    writer.handle(logging.LogRecord("x", logging.INFO, __file__, 1, "%d robots", ("three",), None))
    pipe.read_until("test_logs.py:1: ")
    pipe.read_until("the arguments of '%d robots' cannot be logged\n")


def test_log_of_the_process_is_written_and_left_as_found(
    pipe: Pipe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_STDERR", pipe.writer)
    root, hook = logging.getLogger(), threading.excepthook
    before = root.level, list(root.handlers)
    with write_log(logging.INFO):
        logging.getLogger("catoptra_server.x").info("started")
    pipe.read_until("INFO    catoptra_server.x: started\n")
    assert (root.level, list(root.handlers), threading.excepthook) == (*before, hook)


class _Broken:
    def __del__(self) -> None:
        raise ValueError("in a finalizer")


def fail() -> None:
    raise ValueError("in a thread")


def test_exceptions_that_python_prints_are_logged(
    pipe: Pipe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_STDERR", pipe.writer)
    with write_log(logging.INFO):
        _Broken()
        gc.collect()
        thread = threading.Thread(target=fail, name="sensor")
        thread.start()
        thread.join(DEADLINE_S)
    pipe.read_until("ValueError: in a finalizer\n")
    pipe.read_until("exception in thread sensor\n")
    pipe.read_until("ValueError: in a thread\n")
