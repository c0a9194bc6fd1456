"""When each of a robot's reporters is due next."""

from __future__ import annotations

from collections.abc import Sequence

# Two due times that differ by less than this are the same tick: due times are sums of periods.
_SAME_TIME_S = 1e-6


class ReportSchedule:
    """Periods that all begin at one time: the first reports are due at once."""

    def __init__(self, intervals_s: Sequence[float], time_s: float) -> None:
        self._intervals_s = tuple(intervals_s)
        self._due_s = [time_s] * len(self._intervals_s)

    def pop_due(self, time_s: float) -> list[int]:
        """Return which are due by now, in order, and set their next times."""
        found = [i for i, due_s in enumerate(self._due_s) if time_s >= due_s - _SAME_TIME_S]
        for i in found:
            # From the due time, not from now: a period keeps its mean; after a pause, from now.
            self._due_s[i] = max(self._due_s[i] + self._intervals_s[i], time_s)
        return found
