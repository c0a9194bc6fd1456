"""Share of the runs that satisfy a statement, with its interval of 95 %.

Wilson's score interval (Wilson 1927, JASA 22, p. 209): unlike p ± 1.96 s it stays within [0, 1] and
keeps a width where all runs agree, or none. Newcombe 1998 (Statistics in Medicine 17, p. 857)
compares it with six others.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

# Quantile of 97.5 % of the normal distribution.
_Z = 1.959963984540054


@dataclass(frozen=True, slots=True)
class RunShare:
    """Runs that satisfy a statement, of all runs."""

    num_satisfying: int
    num_runs: int

    @property
    def share(self) -> float:
        """Fraction of the runs; nan of no runs, which no comparison confirms."""
        return self.num_satisfying / self.num_runs if self.num_runs else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the interval of 95 % of the share; (0, 1) of no runs."""
        if not self.num_runs:
            return 0.0, 1.0
        n, z2 = self.num_runs, _Z * _Z
        centre = (self.num_satisfying + 0.5 * z2) / (n + z2)
        half = _Z / (n + z2) * math.sqrt(n * self.share * (1.0 - self.share) + 0.25 * z2)
        # At 0 and n the ends are exactly 0 and 1, up to the rounding of the difference.
        return max(0.0, centre - half), min(1.0, centre + half)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.num_satisfying} of {self.num_runs} runs ({low:.0%} to {high:.0%})"


def count_runs(satisfied: Iterable[bool]) -> RunShare:
    """Share of the runs for which a statement is true."""
    truths = list(satisfied)
    return RunShare(sum(truths), len(truths))


def pool_shares(shares: Iterable[RunShare]) -> RunShare:
    """Share of all runs of several experiments together."""
    listed = list(shares)
    return RunShare(sum(s.num_satisfying for s in listed), sum(s.num_runs for s in listed))
