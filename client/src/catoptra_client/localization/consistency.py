"""Is the filter as sure as it ought to be? NEES against the truth, NIS against the measurements.

Source: Bar-Shalom, Li & Kirubarajan 2001, section 5.4. Averaged over M independent runs, M times
the mean is chi-square with M times the size's degrees of freedom.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from catoptra_client.localization.belief import Belief, correlations
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference

# Of unit variances, rank is plain to see whatever the units: below this only rounding is left.
_SMALLEST_EIGENVALUE = 1e-12
# Up to here the series is summed: some hundred terms a step. Above, Wilson & Hilferty's cube root
# is within 2e-6 of it.
_SUMMED_FREEDOM = 1000
# Nearer to 0 or 1 the series' own rounding, 1e-13, would tell.
_CONFIDENCE = (1e-6, 1.0 - 1e-6)


def nees(belief: Belief, true_pose: Floats) -> tuple[float, bool]:
    """Return the squared error of a belief in units of its covariance, and whether it is defined.

    true_pose (3,), finite. Undefined for a singular covariance, as after a start with P = 0, and
    where it is too large for float64. Mean 3 when consistent.
    """
    truth = np.asarray(true_pose, dtype=np.float64)
    if truth.shape != (3,) or not np.isfinite(truth).all():
        raise DomainError(f"a true pose (x, y, phi) has three finite numbers: {truth}")
    sigma, correlation, _ = correlations(belief.covariance)
    regular = (sigma > 0.0).all() and np.linalg.eigvalsh(correlation)[0] >= _SMALLEST_EIGENVALUE
    if not regular:
        return 0.0, False
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        error = belief.mean - truth
        error[2] = angle_difference(float(belief.mean[2]), float(truth[2]))
        whitened = np.linalg.solve(np.linalg.cholesky(correlation), error / sigma)
        value = float(whitened @ whitened)
    return (value, True) if math.isfinite(value) else (0.0, False)


def mean_interval(size: int, runs: int, *, confidence: float = 0.95) -> tuple[float, float]:
    """Return the two-sided interval of the mean of `runs` chi-square values of `size` freedoms.

    Holds to 2e-6 relative. Domain: at least one freedom, confidence in 1e-6 .. 1 - 1e-6.
    """
    freedom = size * runs
    if freedom < 1 or not _CONFIDENCE[0] <= confidence <= _CONFIDENCE[1]:
        raise DomainError(f"no interval for {size} x {runs} freedoms at {confidence!r}")
    tail = 0.5 * (1.0 - confidence)
    return _quantile(freedom, tail) / runs, _quantile(freedom, 1.0 - tail) / runs


def _quantile(freedom: int, share: float) -> float:
    """Return the number below which a share of chi-square values lies."""
    if freedom > _SUMMED_FREEDOM:
        return _wilson_hilferty(freedom, NormalDist().inv_cdf(share))
    # All quantiles down to a tail of 5e-7 lie below mean + 10 standard deviations + 30.
    low, high = 0.0, freedom + 10.0 * math.sqrt(2.0 * freedom) + 30.0
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if _share_below(freedom, middle) < share else (low, middle)
    return middle


def _share_below(freedom: int, value: float) -> float:
    """Return the chi-square distribution by its series of positive terms: nothing cancels."""
    a, x = 0.5 * freedom, 0.5 * value
    term = math.exp(a * math.log(x) - x - math.lgamma(a + 1.0))
    total, n = term, 1.0
    while term > 1e-17 * total:
        term *= x / (a + n)
        total, n = total + term, n + 1.0
    return total


def _wilson_hilferty(freedom: int, normal: float) -> float:
    """Return the chi-square quantile that belongs to a standard normal one."""
    spread = 2.0 / (9.0 * freedom)
    return float(freedom * (1.0 - spread + normal * spread**0.5) ** 3)
