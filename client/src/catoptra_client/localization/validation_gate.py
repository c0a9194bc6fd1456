"""The validation gate: how far an innovation may lie from the prediction and still be believed.

The squared Mahalanobis distance of a true measurement is chi-square distributed with as many
degrees of freedom as it has numbers. Source: Kristensen & Jensfelt 2003, the gate that the paper
refers to; Bar-Shalom, Li & Kirubarajan 2001.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

from catoptra_protocol.errors import DomainError


@dataclass(frozen=True, slots=True)
class ValidationGate:
    """A gate that wrongly rejects this share of true measurements. 0 lets everything pass.

    0.01 gives -2 ln(0.01) = 9.21034 for range and bearing, 6.63490 for a bearing alone.
    """

    false_rejection_rate: float = 0.01

    def __post_init__(self) -> None:
        if not 0.0 <= self.false_rejection_rate < 1.0:
            raise DomainError(
                f"a share of rejections lies in [0, 1): {self.false_rejection_rate!r}"
            )

    def threshold(self, dof: int) -> float:
        """Return the largest accepted squared distance of an innovation of size 1 or 2."""
        if dof not in (1, 2):
            raise DomainError(f"the gate knows innovations of 1 or 2 numbers, not {dof}")
        if self.false_rejection_rate == 0.0:
            return math.inf
        if dof == 2:
            return -2.0 * math.log(self.false_rejection_rate)
        # Of both tails one half: the quantile near 1 would lose what the small tail keeps. Half of
        # the smallest number is none: the tail is at least that number.
        tail = max(0.5 * self.false_rejection_rate, math.ulp(0.0))
        return NormalDist().inv_cdf(tail) ** 2


PAPER_GATE = ValidationGate(0.01)
OPEN_GATE = ValidationGate(0.0)
