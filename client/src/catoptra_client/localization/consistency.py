"""Is the filter as sure as it ought to be? NEES against the truth, NIS against the measurements.

Source: Bar-Shalom, Li & Kirubarajan 2001, section 5.4. Averaged over M independent runs, M times
the mean is chi-square with M times the size's degrees of freedom.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from catoptra_client.localization.belief import Belief, sigmas_and_correlations
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference

# Of unit variances, rank is plain to see whatever the units: below this only rounding is left.
_MIN_EIGENVALUE = 1e-12
# Up to here the series is summed: some hundred terms a step. Above, Wilson & Hilferty's cube root
# is within 2e-6 of it.
_MAX_SERIES_DOF = 1000
# Nearer to 0 or 1 the series' own rounding, 1e-13, would tell.
_CONFIDENCE_RANGE = (1e-6, 1.0 - 1e-6)


def nees(belief: Belief, true_pose: Floats) -> tuple[float, bool]:
    """Return the squared error of a belief in units of its covariance, and whether it is defined.

    true_pose (3,), finite. Undefined for a singular covariance, as after a start with P = 0, and
    where it is too large for float64. Mean 3 when consistent.
    """
    truth = np.asarray(true_pose, dtype=np.float64)
    if truth.shape != (3,) or not np.isfinite(truth).all():
        raise DomainError(f"a true pose (x, y, phi) has three finite numbers: {truth}")
    sigma, correlation, _ = sigmas_and_correlations(belief.covariance)
    regular = (sigma > 0.0).all() and np.linalg.eigvalsh(correlation)[0] >= _MIN_EIGENVALUE
    if not regular:
        return 0.0, False
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        error = belief.mean - truth
        error[2] = angle_difference(float(belief.mean[2]), float(truth[2]))
        whitened = np.linalg.solve(np.linalg.cholesky(correlation), error / sigma)
        value = float(whitened @ whitened)
    return (value, True) if math.isfinite(value) else (0.0, False)


def chi_square_mean_interval(
    dof: int, num_runs: int, *, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the two-sided interval of the mean of `runs` chi-square values of `size` freedoms.

    Holds to 2e-6 relative. Domain: at least one freedom, confidence in 1e-6 .. 1 - 1e-6.
    """
    freedom = dof * num_runs
    if freedom < 1 or not _CONFIDENCE_RANGE[0] <= confidence <= _CONFIDENCE_RANGE[1]:
        raise DomainError(f"no interval for {dof} x {num_runs} freedoms at {confidence!r}")
    tail = 0.5 * (1.0 - confidence)
    return _chi_square_quantile(freedom, tail) / num_runs, _chi_square_quantile(
        freedom, 1.0 - tail
    ) / num_runs


def _chi_square_quantile(dof: int, probability: float) -> float:
    """Return the number below which a share of chi-square values lies."""
    if dof > _MAX_SERIES_DOF:
        return _wilson_hilferty(dof, NormalDist().inv_cdf(probability))
    # All quantiles down to a tail of 5e-7 lie below mean + 10 standard deviations + 30.
    low, high = 0.0, dof + 10.0 * math.sqrt(2.0 * dof) + 30.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if _chi_square_cdf(dof, middle) < probability else (low, middle)
    return middle


def _chi_square_cdf(dof: int, value: float) -> float:
    """Return the chi-square distribution by its series of positive terms: nothing cancels."""
    a, x = 0.5 * dof, 0.5 * value
    term = math.exp(a * math.log(x) - x - math.lgamma(a + 1.0))
    total, n = term, 1.0
    while term > 1e-17 * total:
        term *= x / (a + n)
        total, n = total + term, n + 1.0
    return total


def _wilson_hilferty(dof: int, normal_quantile: float) -> float:
    """Return the chi-square quantile that belongs to a standard normal one."""
    spread = 2.0 / (9.0 * dof)
    return float(dof * (1.0 - spread + normal_quantile * spread**0.5) ** 3)
