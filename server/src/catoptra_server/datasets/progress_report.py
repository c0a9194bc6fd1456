"""Progress of a data set on standard error: samples done, rate, remaining time."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TextIO

# Often enough to watch, seldom enough for a log.
_TERMINAL_INTERVAL_S = 0.5
_LOG_INTERVAL_S = 30.0


class ProgressReport:
    """Counts samples and writes a line from time to time."""

    def __init__(
        self,
        name: str,
        num_samples: int,
        num_done: int,
        output: TextIO,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count.

        Args:
            name: Name of the data set.
            num_samples: Samples in all.
            num_done: Those of shards that were finished before.
            output: Standard error, or a test's file.
            clock: Monotonic clock in seconds.
        """
        self._name = name
        self._num_samples = num_samples
        self._num_before = self._num_done = num_done
        self._output = output
        self._clock = clock
        self._is_terminal = output.isatty()
        self._start_s = self._last_s = clock()

    def count_samples(self, number: int) -> None:
        """Count more samples as done."""
        self._num_done += number
        now_s = self._clock()
        interval_s = _TERMINAL_INTERVAL_S if self._is_terminal else _LOG_INTERVAL_S
        if now_s - self._last_s >= interval_s:
            self._last_s = now_s
            self._write(self.describe())

    def uncount_samples(self, number: int) -> None:
        """Take back samples of a shard that has to be drawn anew."""
        self._num_done -= number

    def describe(self) -> str:
        """The line."""
        drawn = self._num_done - self._num_before
        elapsed_s = self._clock() - self._start_s
        counts = f"{self._name}: {self._num_done} of {self._num_samples} samples"
        if drawn <= 0 or elapsed_s <= 0.0:
            return counts
        rate = drawn / elapsed_s
        left_s = (self._num_samples - self._num_done) / rate
        return f"{counts}, {rate:.1f} a second, {format_duration(left_s)} left"

    def _write(self, text: str) -> None:
        # On a terminal one line that changes; a log gets lines.
        self._output.write(f"\r\x1b[K{text}" if self._is_terminal else f"{text}\n")
        self._output.flush()

    def finish(self) -> None:
        """Write the last line."""
        self._write(self.describe())
        if self._is_terminal:
            self._output.write("\n")
            self._output.flush()


def format_duration(seconds: float) -> str:
    """Duration as 12 s, 3 min 20 s or 2 h 05 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
