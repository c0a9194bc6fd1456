"""Figures of arrival times within a phase of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise


@dataclass(frozen=True, slots=True)
class Phase:
    """A part of a run, by the monotonic clock."""

    begin_s: float
    end_s: float

    @property
    def length_s(self) -> float:
        """Length of the phase."""
        return self.end_s - self.begin_s

    def intervals_s(self, arrivals_s: Sequence[float]) -> list[float]:
        """Intervals between arrivals that end within the phase, and the one open at its end.

        Args:
            arrivals_s: Increasing times of arrivals, of the whole run.
        """
        until = [time_s for time_s in arrivals_s if time_s <= self.end_s]
        times_s = [*(until or [self.begin_s]), self.end_s]
        return [later - earlier for earlier, later in pairwise(times_s) if later > self.begin_s]

    def rate(self, arrivals_s: Sequence[float]) -> float:
        """Arrivals per second."""
        count = sum(self.begin_s <= time_s <= self.end_s for time_s in arrivals_s)
        return count / self.length_s


def late_fraction(intervals_s: Sequence[float], limit_s: float) -> float:
    """Fraction of intervals longer than a limit."""
    return sum(interval_s > limit_s for interval_s in intervals_s) / max(1, len(intervals_s))
