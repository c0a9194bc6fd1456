"""What a number of runs decides: shares, medians and differences between cameras, with intervals.

A share of runs has an interval of 95 %: Wilson's score interval (Wilson 1927, JASA 22, p. 209).
Unlike p ± 1.96 s this one stays within [0, 1] and keeps a width where all runs agree. Newcombe 1998
(Statistics in Medicine 17, p. 857) compares seven intervals.

Medians have the interval of their order statistics, differences the sign test of paired runs: both
hold for any distribution, also where one locked-out filter lies far from all others. Several tests
share one level by Holm's steps (Holm 1979, Scandinavian Journal of Statistics 6, p. 65).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import accumulate, combinations

import numpy as np

from catoptra_protocol.optics.numerics import Floats

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


def pool_shares(shares: Iterable[RunShare]) -> RunShare:
    """Share of all runs of several experiments together."""
    listed = list(shares)
    return RunShare(sum(s.num_satisfying for s in listed), sum(s.num_runs for s in listed))


def median_with_interval(values: Floats) -> tuple[float, float, float]:
    """Median of (n,) values of runs, and the ends of its interval of at least 95 %.

    The ends are nan for fewer than six runs: even the smallest and the largest value enclose the
    median of all runs in 94 % of the cases only.
    """
    ordered, n = np.sort(values), len(values)
    # Both tails of the binomial distribution of the values below the median: 2.5 % each at most.
    tails = accumulate(math.comb(n, below) for below in range(n // 2 + 1))
    # Whole numbers: from 64 runs on they are beyond NumPy's, from 1024 on beyond float64's.
    rank = sum(tail / 2**n <= 0.025 for tail in tails)
    ends = (ordered[rank - 1], ordered[n - rank]) if rank else (math.nan, math.nan)
    return float(np.median(ordered)), float(ends[0]), float(ends[1])


# Of all statements about pairs together: the chance that any of them is made by chance.
LEVEL = 0.05


@dataclass(frozen=True, slots=True)
class PairDifference:
    """Two subjects over the same runs."""

    lower: str
    higher: str

    runs: RunShare
    """Runs with the smaller value for `lower`, of those in which the values differ."""

    p_value: float
    """Chance of such a share or a more extreme one where neither is better, by Holm's steps."""

    @property
    def is_decided(self) -> bool:
        """Whether the two differ at `LEVEL`."""
        return self.p_value <= LEVEL


def compare_pairs(values: Mapping[str, Floats]) -> list[PairDifference]:
    """Compare subjects with (n,) values of the same runs, those that differ most first."""
    pairs = []
    for first, second in combinations(values, 2):
        counts = {
            first: int((values[first] < values[second]).sum()),
            second: int((values[first] > values[second]).sum()),
        }
        lower, higher = sorted(counts, key=counts.__getitem__, reverse=True)
        share = RunShare(counts[lower], sum(counts.values()))
        pairs.append(PairDifference(lower, higher, share, _sign_test(share)))
    pairs.sort(key=lambda pair: pair.p_value)
    # The k-th smallest of m is multiplied by m - k, and is never below the one before.
    adjusted = accumulate(
        (min(1.0, (len(pairs) - place) * pair.p_value) for place, pair in enumerate(pairs)), max
    )
    return [replace(pair, p_value=p_value) for pair, p_value in zip(pairs, adjusted, strict=True)]


def _sign_test(share: RunShare) -> float:
    """Two-sided p of a share of at least half, where both outcomes have equal chances."""
    num_others = share.num_runs - share.num_satisfying
    ways = sum(math.comb(share.num_runs, count) for count in range(num_others + 1))
    return min(1.0, 2 * ways / (1 << share.num_runs))
