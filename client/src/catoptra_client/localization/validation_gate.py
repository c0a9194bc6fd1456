"""Validation gate: the largest normalized innovation that the filter accepts.

The squared Mahalanobis distance of a true measurement is chi-square distributed with one degree of
freedom per component. Source: Kristensen & Jensfelt 2003, the gate to which the paper refers;
Bar-Shalom, Li & Kirubarajan 2001.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

from catoptra_protocol.errors import DomainError


@dataclass(frozen=True, slots=True)
class ValidationGate:
    """Chi-square gate, described by the fraction of true measurements that are rejected.

    A rate of 0.01 gives the thresholds -2 ln(0.01) = 9.21034 for range and bearing and 6.63490 for
    a bearing alone.
    """

    false_rejection_rate: float = 0.01
    """Fraction of true measurements rejected, in [0, 1); 0 accepts all."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.false_rejection_rate < 1.0:
            raise DomainError(f"a rejection rate lies in [0, 1): {self.false_rejection_rate!r}")

    def threshold(self, dof: int) -> float:
        """Largest accepted squared distance of an innovation with 1 or 2 degrees of freedom."""
        if dof not in (1, 2):
            raise DomainError(f"the gate has thresholds for 1 or 2 degrees of freedom, not {dof}")
        if self.false_rejection_rate == 0.0:
            return math.inf
        if dof == 2:
            # Chi-square with 2 degrees of freedom is exponential: the quantile has a closed form.
            return -2.0 * math.log(self.false_rejection_rate)
        # Half of the rate in each tail of the normal distribution. The lower tail, because 1 - tail
        # rounds to 1 for small rates. Half of the smallest float is 0, hence the maximum.
        tail = max(0.5 * self.false_rejection_rate, math.ulp(0.0))
        return NormalDist().inv_cdf(tail) ** 2


PAPER_GATE = ValidationGate(0.01)
"""Gate of the paper: 1 % of true measurements rejected."""
OPEN_GATE = ValidationGate(0.0)
"""Gate that accepts every measurement."""
