"""Watch the filter from outside: does it still listen to its landmarks?

With a zero a-priori covariance the gate may reject everything for as long as it takes the
covariance to grow (the paper's first 22 steps): a property of the filter, and nothing inside it
bounds that time. So the rejection streak and the windowed NIS are reported, and there is a recovery
that a caller may apply; none happens by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from catoptra_client.localization.belief import Belief
from catoptra_client.localization.ekf import MeasurementUpdate, UpdateStatus
from catoptra_protocol.errors import DomainError

# Its square and the covariance that it is added to fit float64.
_MAX_SIGMA = 1e150


@dataclass(frozen=True, slots=True)
class FilterHealth:
    """What the last steps tell of the filter.

    rejection_streak: steps in a row in which landmarks were compared and none accepted; steps
    without landmarks neither lengthen nor end it. window: (squared distance, size) of the latest
    compared measurements. counts: how often each reason was given since the start.
    """

    window_size: int = 20
    rejection_streak: int = 0
    nis_window: tuple[tuple[float, int], ...] = ()
    status_counts: dict[UpdateStatus, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.window_size < 1:
            raise DomainError(f"a window holds at least one measurement, not {self.window_size!r}")

    @property
    def windowed_nis(self) -> float:
        """Return the window's squared distances per degree of freedom; 1 is healthy, 0 = empty."""
        freedom = sum(size for _, size in self.nis_window)
        return sum(distance for distance, _ in self.nis_window) / freedom if freedom else 0.0

    @property
    def acceptance_rate(self) -> float:
        """Return the share of all compared measurements that were accepted; 1 before the first."""
        accepted = self.status_counts.get(UpdateStatus.ACCEPTED, 0)
        compared = accepted + self.status_counts.get(UpdateStatus.OUTSIDE_GATE, 0)
        return accepted / compared if compared else 1.0


def update_health(health: FilterHealth, updates: Sequence[MeasurementUpdate]) -> FilterHealth:
    """Return the health after all updates of one step."""
    compared = [update for update in updates if update.has_innovation]
    seen = tuple((update.nis, update.innovation.size) for update in compared)
    streak = health.rejection_streak
    if compared:
        streak = 0 if any(update.is_accepted for update in compared) else streak + 1
    counts = dict(health.status_counts)
    for update in updates:
        counts[update.status] = counts.get(update.status, 0) + 1
    window = (health.nis_window + seen)[-health.window_size :]
    return replace(health, rejection_streak=streak, nis_window=window, status_counts=counts)


@dataclass(frozen=True, slots=True)
class Recovery:
    """When to doubt, and how much: after so many rejecting steps add these sigmas' squares to P."""

    min_rejection_streak: int = 5
    position_sigma_m: float = 0.3
    heading_sigma_rad: float = math.radians(10.0)

    def __post_init__(self) -> None:
        if self.min_rejection_streak < 1:
            raise DomainError(
                f"a recovery waits at least one step, not {self.min_rejection_streak!r}"
            )
        sigmas = (self.position_sigma_m, self.heading_sigma_rad)
        if not all(0.0 < sigma < _MAX_SIGMA for sigma in sigmas):
            raise DomainError(f"a recovery's sigmas lie in (0, {_MAX_SIGMA:g}): {sigmas}")


def apply_recovery(
    belief: Belief, health: FilterHealth, *, recovery: Recovery
) -> tuple[Belief, FilterHealth]:
    """Return belief and health, the belief widened if the rejection streak says it is lost.

    The streak starts anew, so that one widening gets its chance before the next.
    """
    if health.rejection_streak < recovery.min_rejection_streak:
        return belief, health
    position, heading = recovery.position_sigma_m**2, recovery.heading_sigma_rad**2
    doubt = np.diag([position, position, heading])
    return Belief(belief.mean, belief.covariance + doubt), replace(health, rejection_streak=0)
