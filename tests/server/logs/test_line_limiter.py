"""Limit of lines per second: repetitions and lines of one template are counted."""

from __future__ import annotations

import logging

from catoptra_server.runtime.logs import MAX_LINES, WINDOW_S, LineLimiter


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
