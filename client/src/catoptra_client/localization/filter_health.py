"""Health of the filter: rejection streak, windowed NIS and a recovery; NEES.

With a zero a-priori covariance the gate rejects every landmark until the covariance has grown (the
first 22 steps in the paper). The filter itself does not bound that time, so streak and NIS are
reported here; nothing recovers automatically, the caller applies the recovery.

With the true pose known, NEES tests consistency: over M independent runs, M times the mean is
chi-square distributed with M times the degrees of freedom of one run. Source: Bar-Shalom, Li &
Kirubarajan 2001, section 5.4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist

import numpy as np

from catoptra_client.localization.ekf import (
    Belief,
    MeasurementUpdate,
    UpdateStatus,
    sigmas_and_correlations,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference

# Rank is judged on correlations, independent of units; smaller eigenvalues are rounding.
_MIN_EIGENVALUE = 1e-12
# Limit of the series, which needs some hundred terms per evaluation there. Above the limit the cube
# root of Wilson & Hilferty agrees with the series within 2e-6.
_MAX_SERIES_DOF = 1000
# Closer to 0 or 1 the rounding of the series, 1e-13, would exceed the stated accuracy.
_CONFIDENCE_RANGE = (1e-6, 1.0 - 1e-6)


def nees(belief: Belief, true_pose: Floats) -> tuple[float, bool]:
    """Normalized estimation error squared of a belief, and whether the value is defined.

    The mean over runs is 3 for a consistent filter. Undefined for a singular covariance, as after a
    start with P = 0, and where the value exceeds float64.

    Args:
        belief: belief to evaluate.
        true_pose: (3,) x, y, phi; finite.
    """
    truth = np.asarray(true_pose, dtype=np.float64)
    if truth.shape != (3,) or not np.isfinite(truth).all():
        raise DomainError(f"a true pose (x, y, phi) has three finite numbers: {truth}")
    sigma, (a, b, c), _ = sigmas_and_correlations(belief.covariance)
    correlation = np.array(((1.0, a, b), (a, 1.0, c), (b, c, 1.0)))
    regular = min(sigma) > 0.0 and np.linalg.eigvalsh(correlation)[0] >= _MIN_EIGENVALUE
    if not regular:
        return 0.0, False
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        # Whitened by sigmas and correlations separately: the Cholesky factor of the correlations
        # does not depend on the units of the pose.
        error = belief.mean - truth
        error[2] = angle_difference(float(belief.mean[2]), float(truth[2]))
        whitened = np.linalg.solve(np.linalg.cholesky(correlation), error / sigma)
        value = float(whitened @ whitened)
    return (value, True) if math.isfinite(value) else (0.0, False)


def chi_square_mean_interval(
    dof: int, num_runs: int, *, confidence: float = 0.95
) -> tuple[float, float]:
    """Two-sided interval of the mean of independent chi-square values.

    Accurate to 2e-6 relative.

    Args:
        dof: degrees of freedom of one value.
        num_runs: number of values in the mean.
        confidence: probability of the interval, in 1e-6 .. 1 - 1e-6.
    """
    total_dof = dof * num_runs
    if total_dof < 1 or not _CONFIDENCE_RANGE[0] <= confidence <= _CONFIDENCE_RANGE[1]:
        raise DomainError(
            f"no interval for {dof} x {num_runs} degrees of freedom at {confidence!r}"
        )
    tail = 0.5 * (1.0 - confidence)
    return _chi_square_quantile(total_dof, tail) / num_runs, _chi_square_quantile(
        total_dof, 1.0 - tail
    ) / num_runs


def _chi_square_quantile(dof: int, probability: float) -> float:
    """Value below which a chi-square variable lies with this probability."""
    if dof > _MAX_SERIES_DOF:
        return _wilson_hilferty(dof, NormalDist().inv_cdf(probability))
    # All quantiles down to a tail of 5e-7 lie below mean + 10 standard deviations + 30.
    low, high = 0.0, dof + 10.0 * math.sqrt(2.0 * dof) + 30.0
    # Bisection down to neighbouring floats: 60 evaluations, no starting value to get wrong.
    while low < (midpoint := 0.5 * (low + high)) < high:
        low, high = (
            (midpoint, high) if _chi_square_cdf(dof, midpoint) < probability else (low, midpoint)
        )
    return midpoint


def _chi_square_cdf(dof: int, value: float) -> float:
    """Chi-square distribution function, by a series of positive terms, which cannot cancel."""
    a, x = 0.5 * dof, 0.5 * value
    # In logarithms: the powers and the gamma function overflow from some 300 degrees of freedom on.
    term = math.exp(a * math.log(x) - x - math.lgamma(a + 1.0))
    total, n = term, 1.0
    while term > 1e-17 * total:
        term *= x / (a + n)
        total, n = total + term, n + 1.0
    return total


def _wilson_hilferty(dof: int, normal_quantile: float) -> float:
    """Approximate chi-square quantile from a standard normal quantile."""
    spread = 2.0 / (9.0 * dof)
    return float(dof * (1.0 - spread + normal_quantile * spread**0.5) ** 3)


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
