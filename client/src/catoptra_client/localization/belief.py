"""Belief of the filter: a Gaussian over the pose (x, y, phi). Immutable."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, wrap_angle

# Rounding of products leaves eigenvalues of a few eps times the largest. 1e-12 is 4500 eps: far
# above rounding, and far below any variance that a robot's sensors can resolve.
_ROUNDING_TOLERANCE = 1e-12
# Square root of the smallest normal float: smaller sigmas have squares of reduced precision.
_MIN_SIGMA = float(np.sqrt(np.finfo(np.float64).tiny))


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Gaussian over the pose in the world frame.

    phi is wrapped, and the covariance symmetrized against rounding. A zero covariance is valid and
    means an exactly known pose, as the paper's a-priori covariance.

    Raises:
        DomainError: a number is not finite, or the covariance not symmetric and positive
            semidefinite.
    """

    mean: Floats
    """Mean pose (3,): m, m, rad."""
    covariance: Floats
    """Covariance (3, 3) of the pose."""
    square_root: Floats = field(init=False, repr=False)
    """Square root B (3, 3) of the covariance: B B^T = covariance."""

    def __post_init__(self) -> None:
        mean = np.array(self.mean, dtype=np.float64)
        covariance = np.array(self.covariance, dtype=np.float64)
        if mean.shape != (3,) or covariance.shape != (3, 3):
            raise DomainError(f"a belief is (3,) and (3, 3), not {mean.shape}, {covariance.shape}")
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise DomainError(f"a belief must be finite: {mean}, {covariance.tolist()}")
        # Wrapped here once, so that no consumer of a belief has to consider whole turns.
        mean[2] = wrap_angle(float(mean[2]))
        # Kept: the test and the filter's next step need the same decomposition.
        root, valid = covariance_square_root(covariance)
        if not valid:
            raise DomainError(
                f"a covariance is symmetric and has no negative variance: {covariance.tolist()}"
            )
        _set_frozen_array(self, "mean", mean)
        _set_frozen_array(self, "covariance", _symmetrize(covariance))
        _set_frozen_array(self, "square_root", root)


def covariance_square_root(covariance: Floats) -> tuple[Floats, bool]:
    """Square root B (n, n) of a covariance of any rank, B B^T, and whether the matrix is one.

    A finite (n, n) matrix is a covariance if it is symmetric without negative eigenvalues, up to
    rounding. By the eigenvectors of the correlations: variances in metres do not hide those in
    radians there, and a Cholesky factor needs full rank, which P = 0 lacks.
    """
    sigma, correlation, possible = sigmas_and_correlations(covariance)
    if not possible:
        return np.zeros_like(correlation), False
    values, vectors = np.linalg.eigh(correlation)
    with np.errstate(under="ignore"):  # products below 1e-308 are zero
        # Eigenvalues that rounding made negative are zeros of a matrix of lower rank.
        root: Floats = sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    return root, bool(values[0] >= -_ROUNDING_TOLERANCE)


def sigmas_and_correlations(covariance: Floats) -> tuple[Floats, Floats, bool]:
    """Sigmas (n,) and correlations (n, n) of a matrix, and whether the matrix can be a covariance.

    The matrix is invalid if a variance is negative, a variance is zero beside a non-zero
    covariance, a correlation exceeds 1, or the matrix is not symmetric; the correlations are then
    zero. A sigma below 1.5e-154, whose square is not a normal float, counts as zero.
    """
    variances = covariance.diagonal()
    sigma = np.sqrt(np.maximum(variances, 0.0))
    certain = sigma < _MIN_SIGMA
    # Dividing twice instead of by the outer product, which underflows for small sigmas.
    scale = np.where(certain, _MIN_SIGMA, sigma)
    with np.errstate(over="ignore", under="ignore"):
        correlation = covariance / scale / scale[:, None]
    possible = bool(variances.min() >= 0.0) and _is_correlation_matrix(correlation)
    if not possible:
        correlation = np.zeros_like(correlation)
    elif certain.any():
        sigma[certain] = 0.0
        correlation[certain | certain[:, None]] = 0.0
    return sigma, correlation, possible


def _is_correlation_matrix(matrix: Floats) -> bool:
    """Whether an (n, n) matrix is symmetric with entries up to 1, up to rounding."""
    if not np.abs(matrix).max() <= 1.0 + _ROUNDING_TOLERANCE:
        return False
    return bool(np.abs(matrix - matrix.T).max() <= _ROUNDING_TOLERANCE)


def _symmetrize(covariance: Floats) -> Floats:
    with np.errstate(under="ignore"):  # half of the smallest float is zero
        symmetric: Floats = 0.5 * covariance + 0.5 * covariance.T
    return symmetric


def _set_frozen_array(belief: Belief, name: str, array: Floats) -> None:
    array.setflags(write=False)
    object.__setattr__(belief, name, array)
