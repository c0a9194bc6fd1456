"""What the filter believes: a Gaussian over the pose (x, y, phi). Immutable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, wrap_angle

# Rounding of products leaves eigenvalues of a few eps times the largest; 1e-12 is some 4500 eps,
# far above that and far below any variance a robot's sensors can tell from zero.
_ROUNDING_TOLERANCE = 1e-12
# The square root of the smallest number of full precision.
_MIN_SIGMA = float(np.sqrt(np.finfo(np.float64).tiny))


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """A mean pose (3,) in the world frame (m, m, rad) and its covariance (3, 3).

    phi is wrapped, and what rounding left of asymmetry is halved away. Raises DomainError for
    numbers that are not finite and for a covariance that is not symmetric and positive
    semidefinite. All zeros is allowed: it says that the pose is known exactly, as the paper's
    a-priori covariance does.
    """

    mean: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        mean = np.array(self.mean, dtype=np.float64)
        covariance = np.array(self.covariance, dtype=np.float64)
        if mean.shape != (3,) or covariance.shape != (3, 3):
            raise DomainError(f"a belief is (3,) and (3, 3), not {mean.shape}, {covariance.shape}")
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise DomainError(f"a belief must be finite: {mean}, {covariance.tolist()}")
        mean[2] = wrap_angle(float(mean[2]))
        if not is_positive_semidefinite(covariance):
            raise DomainError(
                f"a covariance is symmetric and has no negative variance: {covariance.tolist()}"
            )
        _set_frozen_array(self, "mean", mean)
        _set_frozen_array(self, "covariance", _symmetrize(covariance))


def is_positive_semidefinite(covariance: Floats) -> bool:
    """Return whether a finite (n, n) matrix is symmetric without negative eigenvalues.

    Both past rounding, and asked of the correlations, so that metres do not hide radians.
    """
    _, correlation, possible = sigmas_and_correlations(covariance)
    return possible and bool(np.linalg.eigvalsh(correlation)[0] >= -_ROUNDING_TOLERANCE)


def covariance_square_root(covariance: Floats) -> Floats:
    """Return B (n, n) with B B^T = covariance. Domain: positive semidefinite, rank may be low.

    By the eigenvectors of the correlations: a Cholesky factor needs full rank, which P = 0 has not.
    Eigenvalues that rounding made negative are taken as the zeros that they stand for.
    """
    sigma, correlation, _ = sigmas_and_correlations(covariance)
    values, vectors = np.linalg.eigh(correlation)
    with np.errstate(under="ignore"):  # what is below 1e-308 is zero
        root: Floats = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def sigmas_and_correlations(covariance: Floats) -> tuple[Floats, Floats, bool]:
    """Return sigmas (n,), correlations (n, n), and whether they can be those of a covariance.

    They cannot if a variance is negative, or zero beside a covariance that is not, if a correlation
    exceeds 1, or if the matrix is not symmetric. Correlations that cannot be are zeros. A sigma
    below 1.5e-154, whose square float64 holds in part or not at all, is zero.
    """
    variances = np.diagonal(covariance)
    sigma = np.sqrt(np.maximum(variances, 0.0))
    sigma[sigma < _MIN_SIGMA] = 0.0
    certain = sigma == 0.0
    scale = np.where(certain, _MIN_SIGMA, sigma)
    with np.errstate(over="ignore", under="ignore"):
        correlation = covariance / scale / scale[:, None]
    if not (variances.min() >= 0.0 and _is_correlation_matrix(correlation)):
        return sigma, np.zeros_like(correlation), False
    correlation[certain | certain[:, None]] = 0.0
    return sigma, correlation, True


def _is_correlation_matrix(matrix: Floats) -> bool:
    """Return whether no number exceeds 1 and the (n, n) matrix is symmetric, past rounding."""
    if not np.abs(matrix).max() <= 1.0 + _ROUNDING_TOLERANCE:
        return False
    return bool(np.abs(matrix - matrix.T).max() <= _ROUNDING_TOLERANCE)


def _symmetrize(covariance: Floats) -> Floats:
    with np.errstate(under="ignore"):  # half of the smallest number is zero
        symmetric: Floats = 0.5 * covariance + 0.5 * covariance.T
    return symmetric


def _set_frozen_array(belief: Belief, name: str, array: Floats) -> None:
    array.setflags(write=False)
    object.__setattr__(belief, name, array)
