"""Extended Kalman filter over the pose, as functions on immutable beliefs.

Source: Schmits & Visser 2009, Eqs. 4-6; Thrun, Burgard & Fox 2005, table 7.2. Departures:
covariances are products B B^T of square roots (in the update the Joseph form), positive
semidefinite by construction even with exact sensors; the gain comes from a Cholesky solve, never an
inverse; an unusable measurement is rejected with a status and leaves the belief unchanged.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from catoptra_client.localization.belief import Belief, covariance_square_root
from catoptra_client.localization.landmark_map import LandmarkPosition
from catoptra_client.localization.measurement_model import (
    Measurement,
    compute_innovation,
    is_finite,
    predict_measurement,
)
from catoptra_client.localization.motion_model import (
    Control,
    MotionNoise,
    control_covariance,
    jacobian_wrt_control,
    jacobian_wrt_pose,
    propagate_pose,
)
from catoptra_client.localization.validation_gate import ValidationGate
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats

# Radius of a beacon: a robot believed closer than that stands inside the landmark, where the
# linearization of the bearing is meaningless.
MIN_LANDMARK_RANGE_M = 0.05
# A squared pivot below 16 eps of its variance is the rounding residue of zero.
_MIN_RELATIVE_PIVOT = 16.0 * float(np.finfo(np.float64).eps)


class UpdateStatus(StrEnum):
    """Reason why a measurement was accepted or rejected, in words for a log."""

    ACCEPTED = "inside the validation gate"
    OUTSIDE_GATE = "outside the validation gate"
    NOT_FINITE = "the measurement has a number that is not finite"
    INVALID_NOISE_COVARIANCE = "the measurement's covariance is not positive semidefinite"
    AT_LANDMARK = "the landmark stands at the believed position: no bearing is defined"
    SINGULAR = "belief and measurement are both certain: the innovation covariance is singular"
    OVERFLOW = "the numbers are too large for float64"


@dataclass(frozen=True, slots=True, eq=False)
class MeasurementUpdate:
    """Result of one measurement.

    Innovation, its covariance and NIS are defined where `has_innovation`; otherwise empty or zero.
    """

    belief: Belief
    """New belief; the previous belief itself if the measurement was rejected."""
    status: UpdateStatus
    """Reason of acceptance or rejection."""
    innovation: Floats
    """Innovation (n,): measured minus predicted, bearing wrapped."""
    innovation_covariance: Floats
    """Innovation covariance S (n, n)."""
    nis: float
    """Normalized innovation squared: the squared Mahalanobis distance."""

    @property
    def is_accepted(self) -> bool:
        """Whether the measurement entered the belief."""
        return self.status is UpdateStatus.ACCEPTED

    @property
    def has_innovation(self) -> bool:
        """Whether the measurement was usable and compared with the gate."""
        return self.status in (UpdateStatus.ACCEPTED, UpdateStatus.OUTSIDE_GATE)


def predict(belief: Belief, control: Control, *, noise: MotionNoise) -> Belief:
    """Predict the belief over one control: P = G P G^T + V M V^T. Eqs. 4 and 5.

    A control without motion returns the same belief object.

    Args:
        belief: belief before the step.
        control: arc length and turn of the step.
        noise: motion noise parameters.

    Raises:
        DomainError: the predicted belief exceeds float64.
    """
    # The same object: B B^T would round the belief of a robot at rest anew in every step.
    if control.distance_m == 0.0 and control.turn_rad == 0.0:
        return belief
    M = control_covariance(control, noise)  # diagonal
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        G = jacobian_wrt_pose(belief.mean, control)
        V = jacobian_wrt_control(belief.mean, control)
        B = np.hstack((G @ belief.square_root, V @ np.sqrt(M)))
        mean, covariance = propagate_pose(belief.mean, control), B @ B.T
    if not _all_finite(mean, covariance):
        raise DomainError(f"{control} leads beyond float64 from {belief.mean}")
    return Belief(mean, covariance)


def update(
    belief: Belief, measurement: Measurement, *, landmark: LandmarkPosition, gate: ValidationGate
) -> MeasurementUpdate:
    """Correct the belief by one measurement of a landmark, or reject the measurement. Eq. 6.

    Args:
        belief: predicted belief.
        measurement: range and bearing, or bearing alone.
        landmark: position of the measured landmark.
        gate: validation gate.
    """
    if not is_finite(measurement):
        return _reject(belief, UpdateStatus.NOT_FINITE)
    expected, defined = predict_measurement(belief.mean, landmark)
    if not defined or expected.range_m < MIN_LANDMARK_RANGE_M:
        return _reject(belief, UpdateStatus.AT_LANDMARK)
    innovation, H, R = compute_innovation(measurement, expected)
    R_root, valid = covariance_square_root(R)
    if not valid:
        return _reject(belief, UpdateStatus.INVALID_NOISE_COVARIANCE)
    # Underflow to zero is harmless; overflow is checked before a result enters the belief.
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        return _gate_and_correct(belief, innovation, H, R, R_root, gate)


def _gate_and_correct(
    belief: Belief,
    innovation: Floats,
    H: Floats,
    R: Floats,
    R_root: Floats,
    gate: ValidationGate,
) -> MeasurementUpdate:
    """Compare a usable measurement with the gate, then correct the belief.

    R_root: square root of R.
    """
    S = H @ belief.covariance @ H.T + R
    if not _all_finite(S):
        return _reject(belief, UpdateStatus.OVERFLOW)
    L, regular = _cholesky(S)
    if not regular:
        return _reject(belief, UpdateStatus.SINGULAR)
    # Whitened by the triangular factor: never negative, unlike a product with an inverse of S.
    nis = float(np.square(np.linalg.solve(L, innovation)).sum())
    if not math.isfinite(nis):
        return _reject(belief, UpdateStatus.OVERFLOW)
    if nis > gate.threshold(innovation.size):
        return MeasurementUpdate(belief, UpdateStatus.OUTSIDE_GATE, innovation, S, nis)
    corrected, finite = _correct(belief, innovation, H, R_root, L)
    if not finite:
        return _reject(belief, UpdateStatus.OVERFLOW)
    return MeasurementUpdate(corrected, UpdateStatus.ACCEPTED, innovation, S, nis)


def _cholesky(S: Floats) -> tuple[Floats, bool]:
    """Lower Cholesky factor of a symmetric (n, n) matrix, and whether the matrix is regular."""
    # numpy factors matrices that are singular up to rounding, hence the test of the pivots below.
    try:
        L = np.asarray(np.linalg.cholesky(S), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.zeros_like(S), False
    return L, bool((np.square(L.diagonal()) > _MIN_RELATIVE_PIVOT * S.diagonal()).all())


def _correct(
    belief: Belief, innovation: Floats, H: Floats, R_root: Floats, L: Floats
) -> tuple[Belief, bool]:
    """Belief corrected by the gain, and whether it is finite; else the previous belief.

    R_root: square root of R. L: Cholesky factor of the innovation covariance. B B^T is Joseph's
    form (I - K H) P (I - K H)^T + K R K^T.
    """
    K = np.linalg.solve(L.T, np.linalg.solve(L, H @ belief.covariance)).T
    root = belief.square_root
    # Square-root blocks side by side: their product is Joseph's form, and cannot lose symmetry.
    B = np.hstack((root - K @ (H @ root), K @ R_root))
    mean, covariance = belief.mean + K @ innovation, B @ B.T
    if not _all_finite(mean, covariance):
        return belief, False
    return Belief(mean, covariance), True


def _all_finite(*arrays: Floats) -> bool:
    return all(bool(np.isfinite(array).all()) for array in arrays)


def _reject(belief: Belief, status: UpdateStatus) -> MeasurementUpdate:
    return MeasurementUpdate(belief, status, np.zeros(0), np.zeros((0, 0)), 0.0)
