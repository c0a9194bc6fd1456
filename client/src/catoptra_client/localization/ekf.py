"""The extended Kalman filter over the pose: functions on immutable beliefs.

Source: Schmits & Visser 2009, Eqs. 4-6; Thrun, Burgard & Fox 2005, table 7.2. Departures: the
covariance is carried as a product B B^T of square roots, in the update the Joseph form, so that it
is positive semidefinite by construction with exact sensors too; the gain comes from a Cholesky
solve, never an inverse; and what cannot be used is refused with a reason instead of spoiling the
belief.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from catoptra_client.localization.belief import (
    Belief,
    covariance_square_root,
    is_positive_semidefinite,
)
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

# A robot that believes itself nearer to a landmark than a beacon's radius (0.05 m) would stand in
# it: the bearing says nothing there, and its linearisation less.
MIN_LANDMARK_RANGE_M = 0.05


class UpdateStatus(StrEnum):
    """Why a measurement was taken or refused, in words for a log."""

    ACCEPTED = "inside the validation gate"
    OUTSIDE_GATE = "outside the validation gate"
    NOT_FINITE = "the measurement has a number that is not finite"
    INVALID_NOISE_COVARIANCE = "the measurement's covariance is not positive semidefinite"
    AT_LANDMARK = "the landmark stands at the believed position: no bearing is defined"
    SINGULAR = "belief and measurement are both certain: the innovation covariance is singular"
    OVERFLOW = "the numbers are too large for float64"


@dataclass(frozen=True, slots=True, eq=False)
class MeasurementUpdate:
    """What became of one measurement.

    belief: the new one, or the old one itself if the measurement was refused. innovation (n,),
    innovation_covariance (n, n) and distance_squared are defined where `was_compared`; else zeros.
    """

    belief: Belief
    status: UpdateStatus
    innovation: Floats
    innovation_covariance: Floats
    nis: float

    @property
    def is_accepted(self) -> bool:
        """Return whether the measurement entered the belief."""
        return self.status is UpdateStatus.ACCEPTED

    @property
    def has_innovation(self) -> bool:
        """Return whether the measurement was sound enough to be put before the gate."""
        return self.status in (UpdateStatus.ACCEPTED, UpdateStatus.OUTSIDE_GATE)


def predict(belief: Belief, control: Control, *, noise: MotionNoise) -> Belief:
    """Return the belief after one control: P = G P G^T + V M V^T.

    A robot that stands still is believed where it was, to the bit: the very belief is returned.
    Raises DomainError for a control that leads out of float64.
    """
    if control.distance_m == 0.0 and control.turn_rad == 0.0:
        return belief
    M = control_covariance(control, noise)  # diagonal
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        G = jacobian_wrt_pose(belief.mean, control)
        V = jacobian_wrt_control(belief.mean, control)
        B = np.hstack((G @ covariance_square_root(belief.covariance), V @ np.sqrt(M)))
        mean, covariance = propagate_pose(belief.mean, control), B @ B.T
    if not _all_finite(mean, covariance):
        raise DomainError(f"{control} leads out of what float64 can hold from {belief.mean}")
    return Belief(mean, covariance)


def update(
    belief: Belief, measurement: Measurement, *, landmark: LandmarkPosition, gate: ValidationGate
) -> MeasurementUpdate:
    """Return the belief after one measurement of a landmark, or the reason why it was refused."""
    if not is_finite(measurement):
        return _reject(belief, UpdateStatus.NOT_FINITE)
    expected, defined = predict_measurement(belief.mean, landmark)
    if not defined or expected.range_m < MIN_LANDMARK_RANGE_M:
        return _reject(belief, UpdateStatus.AT_LANDMARK)
    innovation, H, R = compute_innovation(measurement, expected)
    if not is_positive_semidefinite(R):
        return _reject(belief, UpdateStatus.INVALID_NOISE_COVARIANCE)
    # What is below 1e-308 is zero; what is too large is looked for where it would enter.
    with np.errstate(over="ignore", invalid="ignore", under="ignore"):
        return _gate_and_correct(belief, innovation, H, R, gate)


def _gate_and_correct(
    belief: Belief, innovation: Floats, H: Floats, R: Floats, gate: ValidationGate
) -> MeasurementUpdate:
    """Return the update with sound numbers: put them before the gate, then take them in."""
    S = H @ belief.covariance @ H.T + R
    if not _all_finite(S):
        return _reject(belief, UpdateStatus.OVERFLOW)
    L, regular = _cholesky(S)
    if not regular:
        return _reject(belief, UpdateStatus.SINGULAR)
    distance_squared = float(np.square(np.linalg.solve(L, innovation)).sum())
    if not math.isfinite(distance_squared):
        return _reject(belief, UpdateStatus.OVERFLOW)
    if distance_squared > gate.threshold(innovation.size):
        return MeasurementUpdate(belief, UpdateStatus.OUTSIDE_GATE, innovation, S, distance_squared)
    corrected, finite = _correct(belief, innovation, H, R, L)
    if not finite:
        return _reject(belief, UpdateStatus.OVERFLOW)
    return MeasurementUpdate(corrected, UpdateStatus.ACCEPTED, innovation, S, distance_squared)


def _cholesky(S: Floats) -> tuple[Floats, bool]:
    """Return the lower factor of a symmetric (n, n) matrix, and whether it is regular.

    A squared pivot below 16 eps of its variance is what rounding leaves of a zero.
    """
    try:
        L = np.asarray(np.linalg.cholesky(S), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.zeros_like(S), False
    floor = 16.0 * np.finfo(np.float64).eps * np.diagonal(S)
    return L, bool((np.square(np.diagonal(L)) > floor).all())


def _correct(
    belief: Belief, innovation: Floats, H: Floats, R: Floats, L: Floats
) -> tuple[Belief, bool]:
    """Return the belief moved by its gain, and whether it is finite (else it is the old one).

    L: Cholesky factor of the innovation covariance. B B^T is Joseph's form
    (I - K H) P (I - K H)^T + K R K^T.
    """
    K = np.linalg.solve(L.T, np.linalg.solve(L, H @ belief.covariance)).T
    root = covariance_square_root(belief.covariance)
    B = np.hstack((root - K @ (H @ root), K @ covariance_square_root(R)))
    mean, covariance = belief.mean + K @ innovation, B @ B.T
    if not _all_finite(mean, covariance):
        return belief, False
    return Belief(mean, covariance), True


def _all_finite(*arrays: Floats) -> bool:
    return all(bool(np.isfinite(array).all()) for array in arrays)


def _reject(belief: Belief, status: UpdateStatus) -> MeasurementUpdate:
    return MeasurementUpdate(belief, status, np.zeros(0), np.zeros((0, 0)), 0.0)
