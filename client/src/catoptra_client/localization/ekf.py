"""Extended Kalman filter over the pose (x, y, phi), as functions on immutable beliefs.

A belief is a Gaussian; a measurement is range and bearing of a landmark, or a bearing alone near
the horizon, where there is no usable range. The bearing gamma is relative to the robot's heading
and positive to the right (x towards y), as yaw. The gate is the largest normalized innovation that
the filter accepts: the squared Mahalanobis distance of a true measurement is chi-square distributed
with one degree of freedom per component. The motion model is in `motion_model`.

Source: Schmits & Visser 2009, Eqs. 4-6; Thrun, Burgard & Fox 2005, table 7.2; for the gate
Kristensen & Jensfelt 2003, to which the paper refers, and Bar-Shalom, Li & Kirubarajan 2001.
Departures: covariances are products B B^T of square roots (in the update the Joseph form), positive
semidefinite by construction even with exact sensors; the gain comes from a Cholesky solve, never an
inverse; an unusable measurement is rejected with a status and leaves the belief unchanged.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field
from enum import Enum
from statistics import NormalDist

import numpy as np

from catoptra_client.landmarks.candidates import Detection
from catoptra_client.localization.landmark_map import LandmarkPosition
from catoptra_client.localization.motion_model import (
    Control,
    MotionNoise,
    control_covariance,
    jacobian_wrt_control,
    jacobian_wrt_pose,
    propagate_pose,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference, wrap_angle


@dataclass(frozen=True, slots=True)
class ValidationGate:
    """Chi-square gate, described by the fraction of true measurements that are rejected.

    A rate of 0.01 gives the thresholds -2 ln(0.01) = 9.21034 for range and bearing and 6.63490 for
    a bearing alone.
    """

    false_rejection_rate: float = 0.01
    """Fraction of true measurements rejected, in [0, 1); 0 accepts all."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.false_rejection_rate < 1.0:
            raise DomainError(f"a rejection rate lies in [0, 1): {self.false_rejection_rate!r}")

    def threshold(self, dof: int) -> float:
        """Largest accepted squared distance of an innovation with 1 or 2 degrees of freedom."""
        if dof not in (1, 2):
            raise DomainError(f"the gate has thresholds for 1 or 2 degrees of freedom, not {dof}")
        if self.false_rejection_rate == 0.0:
            return math.inf
        if dof == 2:
            # Chi-square with 2 degrees of freedom is exponential: the quantile has a closed form.
            return -2.0 * math.log(self.false_rejection_rate)
        # Half of the rate in each tail of the normal distribution. The lower tail, because 1 - tail
        # rounds to 1 for small rates. Half of the smallest float is 0, hence the maximum.
        tail = max(0.5 * self.false_rejection_rate, math.ulp(0.0))
        return NormalDist().inv_cdf(tail) ** 2


PAPER_GATE = ValidationGate(0.01)
"""Gate of the paper: 1 % of true measurements rejected."""
OPEN_GATE = ValidationGate(0.0)
"""Gate that accepts every measurement."""


# Rounding of products leaves eigenvalues of a few eps times the largest. 1e-12 is 4500 eps: far
# above rounding, and far below any variance that a robot's sensors can resolve.
_ROUNDING_TOLERANCE = 1e-12
_MAX_CORRELATION = 1.0 + _ROUNDING_TOLERANCE
# The smallest normal float: smaller variances have a reduced precision.
_MIN_VARIANCE = sys.float_info.min
_MIN_SIGMA = math.sqrt(_MIN_VARIANCE)


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
        if not _all_finite(mean, covariance):
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
        if covariance.tolist() != covariance.T.tolist():
            with np.errstate(under="ignore"):  # half of the smallest float is zero
                covariance = 0.5 * covariance + 0.5 * covariance.T
        _set_frozen_array(self, "covariance", covariance)
        _set_frozen_array(self, "square_root", root)


# Closed forms in Python's floats: matrices of up to three rows take LAPACK five times as long, and
# over- and underflow need no `errstate` here. Measured in tests/measurements/detection_time.py.
_PAIRS = ((), (), ((1, 0),), ((1, 0), (2, 0), (2, 1)))


def covariance_square_root(covariance: Floats) -> tuple[Floats, bool]:
    """Square root B (n, n) of a covariance of any rank, B B^T, and whether the matrix is one.

    A finite (n, n) matrix, n <= 3, is a covariance if it is symmetric without negative eigenvalues,
    up to rounding. By a pivoted Cholesky factor of the correlations: variances in metres do not
    hide those in radians there, and equal eigenvalues are no special case, as for eigenvectors.
    """
    sigma, correlations, possible = sigmas_and_correlations(covariance)
    if not possible:
        return np.zeros_like(covariance), False
    if len(sigma) == 1:
        return np.array([sigma]), True
    s, t, *others = sigma
    a, *rest = correlations
    p = (1.0 - a) * (1.0 + a)
    if not others:
        return np.array(((s, 0.0), (t * a, t * math.sqrt(max(p, 0.0))))), True
    (u,), (b, c) = others, rest
    # The first pivot is 1; it leaves ((p, q), (q, r)), whose negative eigenvalue is up to three
    # times that of the correlations.
    q, r = c - a * b, (1.0 - b) * (1.0 + b)
    valid = 0.5 * (p + r) - math.hypot(0.5 * (p - r), q) >= -3.0 * _ROUNDING_TOLERANCE
    # The next pivot is the larger one, which bounds |q|: an error of q is not enlarged by 1 / root.
    # What rounding made negative is a zero of a matrix of lower rank.
    root = math.sqrt(max(p, r, 0.0))
    across = max(-root, min(q / root, root)) if root else 0.0
    last = math.sqrt(max(min(p, r) - across * across, 0.0))
    (e, f), (g, h) = ((root, 0.0), (across, last)) if p >= r else ((across, last), (root, 0.0))
    return np.array(((s, 0.0, 0.0), (t * a, t * e, t * f), (u * b, u * g, u * h))), valid


def sigmas_and_correlations(covariance: Floats) -> tuple[list[float], list[float], bool]:
    """Sigmas (n,) of a matrix, its correlations below the diagonal, and if it can be a covariance.

    The matrix, n <= 3, is invalid if a variance is negative, a variance is zero beside a non-zero
    covariance, a correlation exceeds 1, or the matrix is not symmetric. A sigma below 1.5e-154,
    whose square is not a normal float, counts as zero, and so do its correlations.
    """
    rows = covariance.tolist()
    variances = [row[i] for i, row in enumerate(rows)]
    possible = min(variances) >= 0.0
    sigma = [math.sqrt(v) if v >= _MIN_VARIANCE else 0.0 for v in variances]
    correlations = []
    for i, j in _PAIRS[len(rows)]:
        one, other = sigma[i] or _MIN_SIGMA, sigma[j] or _MIN_SIGMA
        # Dividing twice instead of by the product, which underflows for small sigmas.
        lower, upper = rows[i][j] / other / one, rows[j][i] / other / one
        possible &= abs(lower) <= _MAX_CORRELATION and abs(lower - upper) <= _ROUNDING_TOLERANCE
        correlations.append(lower if sigma[i] and sigma[j] else 0.0)
    return sigma, correlations, possible


def _set_frozen_array(belief: Belief, name: str, array: Floats) -> None:
    array.setflags(write=False)
    object.__setattr__(belief, name, array)


@dataclass(frozen=True, slots=True, eq=False)
class RangeBearing:
    """Range and bearing of a landmark."""

    range_m: float
    """Level range r."""
    bearing_rad: float
    """Bearing gamma."""
    covariance: Floats
    """Covariance (2, 2) of (r, gamma): m^2, rad^2."""

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=np.float64)
        if covariance.shape != (2, 2):
            raise DomainError(f"range and bearing have a (2, 2) covariance, not {covariance.shape}")
        covariance.setflags(write=False)
        object.__setattr__(self, "covariance", covariance)


@dataclass(frozen=True, slots=True)
class BearingOnly:
    """Bearing of a landmark without a range."""

    bearing_rad: float
    """Bearing gamma."""
    variance_rad2: float
    """Variance of the bearing."""


Measurement = RangeBearing | BearingOnly


def measurement_from_detection(detection: Detection) -> Measurement:
    """Measurement of a detection: range and bearing, or the bearing alone."""
    if detection.has_range:
        return RangeBearing(detection.range_m, detection.bearing_rad, detection.covariance)
    return BearingOnly(detection.bearing_rad, float(detection.covariance[1, 1]))


@dataclass(frozen=True, slots=True, eq=False)
class PredictedMeasurement:
    """Range and bearing of a landmark as predicted from a pose."""

    range_m: float
    bearing_rad: float
    jacobian: Floats
    """Jacobian H (2, 3) of range and bearing with respect to the pose."""


def predict_measurement(
    pose: Floats, landmark: LandmarkPosition
) -> tuple[PredictedMeasurement, bool]:
    """Predicted measurement of a landmark from a (3,) pose, and whether it is defined.

    Undefined where the landmark coincides with the robot: bearing and H have no limit there.
    """
    dx, dy = landmark.x_m - float(pose[0]), landmark.y_m - float(pose[1])
    rho = math.hypot(dx, dy)
    # The reciprocal of a subnormal range overflows; that of the smallest normal one is finite.
    if not sys.float_info.min < rho < math.inf:
        return PredictedMeasurement(0.0, 0.0, np.zeros((2, 3))), False
    # Direction cosines, then a second division by rho: rho^2 would under- or overflow first.
    cx, cy = dx / rho, dy / rho
    jacobian = np.array([[-cx, -cy, 0.0], [cy / rho, -cx / rho, -1.0]])
    bearing_rad = angle_difference(math.atan2(dy, dx), float(pose[2]))
    return PredictedMeasurement(rho, bearing_rad, jacobian), True


def compute_innovation(
    measurement: Measurement, predicted: PredictedMeasurement
) -> tuple[Floats, Floats, Floats]:
    """Innovation (n,), H (n, 3) and R (n, n); n = 2, or 1 for a bearing alone.

    The innovation of the bearing is wrapped.
    """
    # Wrapped: a bearing near +-pi would otherwise be off by a whole turn and fail any gate.
    bearing_innovation_rad = angle_difference(measurement.bearing_rad, predicted.bearing_rad)
    if isinstance(measurement, BearingOnly):
        noise = np.array([[measurement.variance_rad2]])
        return np.array([bearing_innovation_rad]), predicted.jacobian[1:], noise
    innovation = np.array([measurement.range_m - predicted.range_m, bearing_innovation_rad])
    return innovation, predicted.jacobian, measurement.covariance


def is_finite(measurement: Measurement) -> bool:
    """Whether every number of a measurement is finite."""
    if isinstance(measurement, BearingOnly):
        return math.isfinite(measurement.bearing_rad) and math.isfinite(measurement.variance_rad2)
    numbers = (measurement.range_m, measurement.bearing_rad)
    return all(map(math.isfinite, numbers)) and _all_finite(measurement.covariance)


# Radius of a beacon: a robot believed closer than that stands inside the landmark, where the
# linearization of the bearing is meaningless.
_MIN_LANDMARK_RANGE_M = 0.05
# A squared pivot below 16 eps of its variance is the rounding residue of zero.
_MIN_RELATIVE_PIVOT = 16.0 * float(np.finfo(np.float64).eps)


class UpdateStatus(str, Enum):
    """Reason why a measurement was accepted or rejected, in words for a log."""

    ACCEPTED = "inside the validation gate"
    OUTSIDE_GATE = "outside the validation gate"
    NOT_FINITE = "the measurement has a number that is not finite"
    INVALID_NOISE_COVARIANCE = "the measurement's covariance is not positive semidefinite"
    AT_LANDMARK = "the landmark stands at the believed position: no bearing is defined"
    SINGULAR = "belief and measurement are both certain: the innovation covariance is singular"
    OVERFLOW = "the numbers are too large for float64"

    __str__ = str.__str__


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
        B = np.concatenate((G @ belief.square_root, V @ np.sqrt(M)), axis=1)
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
    if not defined or expected.range_m < _MIN_LANDMARK_RANGE_M:
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
    whitened = _solve_lower(L, innovation)
    nis = float(whitened @ whitened)
    if not math.isfinite(nis):
        return _reject(belief, UpdateStatus.OVERFLOW)
    if nis > gate.threshold(innovation.size):
        return MeasurementUpdate(belief, UpdateStatus.OUTSIDE_GATE, innovation, S, nis)
    corrected, finite = _correct(belief, innovation, H, R_root, L)
    if not finite:
        return _reject(belief, UpdateStatus.OVERFLOW)
    return MeasurementUpdate(corrected, UpdateStatus.ACCEPTED, innovation, S, nis)


def _cholesky(S: Floats) -> tuple[Floats, bool]:
    """Lower Cholesky factor of a symmetric (n, n) matrix, n <= 2, and whether it is regular."""
    (s, *_), *others = S.tolist()
    root = math.sqrt(max(s, 0.0))
    if not (root and others):
        return np.array([[root]]), root > 0.0
    ((across, last),) = others
    across /= root
    pivot = last - across * across
    if not pivot > _MIN_RELATIVE_PIVOT * last:
        return np.zeros_like(S), False
    return np.array([[root, 0.0], [across, math.sqrt(pivot)]]), True


def _solve_lower(L: Floats, right: Floats) -> Floats:
    """X (n, ...) of L X = right, by forward substitution; L (n, n) is lower triangular, n <= 2."""
    if len(L) == 1:
        return np.asarray(right / L[0])
    (a, _), (b, c) = L.tolist()
    first = right[0] / a
    return np.array((first, (right[1] - b * first) / c))


def _solve_upper(U: Floats, right: Floats) -> Floats:
    """X (n, ...) of U X = right, by back substitution; U (n, n) is upper triangular, n <= 2."""
    if len(U) == 1:
        return np.asarray(right / U[0])
    (a, b), (_, c) = U.tolist()
    last = right[1] / c
    return np.array(((right[0] - b * last) / a, last))


def _correct(
    belief: Belief, innovation: Floats, H: Floats, R_root: Floats, L: Floats
) -> tuple[Belief, bool]:
    """Belief corrected by the gain, and whether it is finite; else the previous belief.

    R_root: square root of R. L: Cholesky factor of the innovation covariance. B B^T is Joseph's
    form (I - K H) P (I - K H)^T + K R K^T.
    """
    K = _solve_upper(L.T, _solve_lower(L, H @ belief.covariance)).T
    root = belief.square_root
    # Square-root blocks side by side: their product is Joseph's form, and cannot lose symmetry.
    B = np.concatenate((root - K @ (H @ root), K @ R_root), axis=1)
    mean, covariance = belief.mean + K @ innovation, B @ B.T
    if not _all_finite(mean, covariance):
        return belief, False
    return Belief(mean, covariance), True


def _all_finite(*arrays: Floats) -> bool:
    return all(all(map(math.isfinite, array.ravel().tolist())) for array in arrays)


def _reject(belief: Belief, status: UpdateStatus) -> MeasurementUpdate:
    return MeasurementUpdate(belief, status, np.zeros(0), np.zeros((0, 0)), 0.0)
