"""Health of the filter: rejection streak, windowed NIS, and a recovery for the caller to apply.

With a zero a-priori covariance the gate rejects every landmark until the covariance has grown (the
first 22 steps in the paper). The filter itself does not bound that time, so streak and NIS are
reported here; nothing recovers automatically.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from catoptra_client.localization.belief import Belief
from catoptra_client.localization.ekf import MeasurementUpdate, UpdateStatus
from catoptra_protocol.errors import DomainError

# The square, added to a covariance, is finite.
_MAX_SIGMA = 1e150


@dataclass(frozen=True, slots=True)
class FilterHealth:
    """Statistics of the latest measurements."""

    window_size: int = 20
    """Number of measurements in the NIS window."""
    rejection_streak: int = 0
    """Consecutive steps with compared landmarks, none of which was accepted.

    Steps without landmarks neither extend nor end the streak.
    """
    nis_window: tuple[tuple[float, int], ...] = ()
    """NIS and degrees of freedom of the latest compared measurements."""
    status_counts: dict[UpdateStatus, int] = field(default_factory=dict)
    """Number of measurements by status since the start."""

    def __post_init__(self) -> None:
        if self.window_size < 1:
            raise DomainError(f"a window holds at least one measurement, not {self.window_size!r}")

    @property
    def windowed_nis(self) -> float:
        """NIS of the window per degree of freedom: 1 if consistent, 0 if empty."""
        total_dof = sum(dof for _, dof in self.nis_window)
        return sum(nis for nis, _ in self.nis_window) / total_dof if total_dof else 0.0

    @property
    def acceptance_rate(self) -> float:
        """Fraction of compared measurements that were accepted; 1 before the first."""
        # Unusable measurements count in neither number: the rate is that of the gate's decisions.
        accepted = self.status_counts.get(UpdateStatus.ACCEPTED, 0)
        compared = accepted + self.status_counts.get(UpdateStatus.OUTSIDE_GATE, 0)
        return accepted / compared if compared else 1.0


def update_health(health: FilterHealth, updates: Sequence[MeasurementUpdate]) -> FilterHealth:
    """Health after all measurement updates of one step."""
    compared = [update for update in updates if update.has_innovation]
    entries = tuple((update.nis, update.innovation.size) for update in compared)
    # Without compared landmarks there is no evidence in either direction.
    streak = health.rejection_streak
    if compared:
        streak = 0 if any(update.is_accepted for update in compared) else streak + 1
    counts = dict(health.status_counts)
    for update in updates:
        counts[update.status] = counts.get(update.status, 0) + 1
    window = (health.nis_window + entries)[-health.window_size :]
    return replace(health, rejection_streak=streak, nis_window=window, status_counts=counts)


@dataclass(frozen=True, slots=True)
class Recovery:
    """Rule that widens a belief after a streak of rejections."""

    min_rejection_streak: int = 5
    """Streak from which the belief is widened."""
    position_sigma_m: float = 0.3
    """Sigma added to x and y."""
    heading_sigma_rad: float = math.radians(10.0)
    """Sigma added to the heading."""

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
    """Widen the belief if the rejection streak has reached the limit of the recovery.

    Returns:
        Belief and health; the streak restarts after a widening.
    """
    if health.rejection_streak < recovery.min_rejection_streak:
        return belief, health
    position, heading = recovery.position_sigma_m**2, recovery.heading_sigma_rad**2
    # Added, not replaced: correlations survive, and one widening takes effect before the next.
    added_covariance = np.diag([position, position, heading])
    return Belief(belief.mean, belief.covariance + added_covariance), replace(
        health, rejection_streak=0
    )
