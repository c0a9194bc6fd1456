"""Consistency of the filter: NEES against the true pose, and intervals of chi-square means.

Source: Bar-Shalom, Li & Kirubarajan 2001, section 5.4. Over M independent runs, M times the mean is
chi-square distributed with M times the degrees of freedom of one run.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from catoptra_client.localization.belief import Belief, sigmas_and_correlations
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
    sigma, correlation, _ = sigmas_and_correlations(belief.covariance)
    regular = (sigma > 0.0).all() and np.linalg.eigvalsh(correlation)[0] >= _MIN_EIGENVALUE
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
