"""Is the filter as sure as it ought to be? NEES against the truth, NIS against the measurements.

Source: Bar-Shalom, Li & Kirubarajan 2001, section 5.4. Averaged over M independent runs, M times
the mean is chi-square with M times the size's degrees of freedom.
"""

from __future__ import annotations

from statistics import NormalDist

import numpy as np

from catoptra_client.localization.belief import Belief
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, wrap_angle


def nees(belief: Belief, true_pose: Floats) -> tuple[float, bool]:
    """Return the squared error of a belief in units of its covariance, and whether it is defined.

    true_pose (3,). Undefined for a singular covariance, as after a start with P = 0. Mean 3 when
    consistent.
    """
    error = belief.mean - np.asarray(true_pose, dtype=np.float64)
    error[2] = wrap_angle(float(error[2]))
    sigma = np.sqrt(np.diagonal(belief.covariance))
    if not (sigma > 0.0).all():
        return 0.0, False
    # Of unit variances, rank is plain to see whatever the units: below 1e-12 only rounding is left.
    correlation = belief.covariance / np.outer(sigma, sigma)
    if np.linalg.eigvalsh(correlation)[0] < 1e-12:
        return 0.0, False
    whitened = np.linalg.solve(np.linalg.cholesky(correlation), error / sigma)
    return float(whitened @ whitened), True


def mean_interval(size: int, runs: int, *, confidence: float = 0.95) -> tuple[float, float]:
    """Return the two-sided interval of the mean of `runs` chi-square values of `size` freedoms.

    Wilson & Hilferty's cube-root approximation; within 1e-3 of the exact one from 50 freedoms on.
    """
    freedom = size * runs
    if freedom < 1 or not 0.0 < confidence < 1.0:
        raise DomainError(f"no interval for {size} x {runs} freedoms at {confidence!r}")
    half_width = NormalDist().inv_cdf(0.5 + 0.5 * confidence)
    return (
        _wilson_hilferty(freedom, -half_width) / runs,
        _wilson_hilferty(freedom, half_width) / runs,
    )


def _wilson_hilferty(freedom: int, normal: float) -> float:
    """Return the chi-square quantile that belongs to a standard normal one."""
    spread = 2.0 / (9.0 * freedom)
    return float(freedom * (1.0 - spread + normal * spread**0.5) ** 3)
