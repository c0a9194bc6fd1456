"""Limit of lines of the log per second: repeated lines are counted in place of written.

A client can cause a line at will, by connecting or by a wrong command; the lines of the others
must remain readable. A limit counts per logger, level and template, such as 'controller %s
connected', within a second from its first line.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass

WINDOW_S = 1.0
# Different lines of one template per window. Sixteen robots that connect at once log all their
# lines; 185 connections in a second log 20 and a count.
MAX_LINES = 20

# Logger, level and template.
_Kind = tuple[str, int, str]


@dataclass(slots=True)
class _Window:
    """Lines of one kind since the first of them."""

    end_s: float
    repetitions: dict[str, int] = field(default_factory=dict)
    """Number of repetitions of each line that was written."""
    num_suppressed: int = 0
    """Number of lines above the limit."""


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
