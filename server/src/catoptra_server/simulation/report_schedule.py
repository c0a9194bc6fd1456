"""Times at which the sensors of a robot report."""

from __future__ import annotations

from collections.abc import Sequence

# Two times closer than this are one tick: due times are sums of periods as floats.
_SAME_TIME_S = 1e-6


class ReportSchedule:
    """Periods that start together: all first reports are due at once."""

    def __init__(self, intervals_s: Sequence[float], time_s: float) -> None:
        """Start the periods at a simulation time, one for each interval."""
        self._intervals_s = tuple(intervals_s)
        self._due_s = [time_s] * len(self._intervals_s)

    def pop_due(self, time_s: float) -> list[int]:
        """Indices that are due at a time, in order; their next times are set."""
        found = [i for i, due_s in enumerate(self._due_s) if time_s >= due_s - _SAME_TIME_S]
        for i in found:
            # Counted from the due time, not from now, so that a period of 0.05 s keeps its mean in
            # ticks of 0.02 s; after a pause from now, so that no burst of reports follows.
            self._due_s[i] = max(self._due_s[i] + self._intervals_s[i], time_s)
        return found
