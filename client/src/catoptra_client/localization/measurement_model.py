"""The measurement model: range and bearing of a landmark (Schmits & Visser 2009, Eq. 6).

Bearing gamma is counted from the robot's heading, positive to the right (x towards y), as yaw is. A
landmark near the horizon has no usable range; then only its bearing is a measurement.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.detection import Detection
from catoptra_client.localization.landmark_map import LandmarkPosition
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference


@dataclass(frozen=True, slots=True, eq=False)
class RangeBearing:
    """A landmark's level range r and bearing gamma; covariance (2, 2) of (r, gamma): m^2, rad^2."""

    range_m: float
    bearing_rad: float
    covariance: Floats

    def __post_init__(self) -> None:
        covariance = np.array(self.covariance, dtype=np.float64)
        if covariance.shape != (2, 2):
            raise DomainError(f"range and bearing have a (2, 2) covariance, not {covariance.shape}")
        covariance.setflags(write=False)
        object.__setattr__(self, "covariance", covariance)


@dataclass(frozen=True, slots=True)
class BearingOnly:
    """A landmark's bearing gamma and its variance, rad^2."""

    bearing_rad: float
    variance_rad2: float


Measurement = RangeBearing | BearingOnly


def measurement_from_detection(detection: Detection) -> Measurement:
    """Return what a detection tells the filter; without a range, its bearing alone."""
    if detection.has_range:
        return RangeBearing(detection.range_m, detection.bearing_rad, detection.covariance)
    return BearingOnly(detection.bearing_rad, float(detection.covariance[1, 1]))


@dataclass(frozen=True, slots=True, eq=False)
class PredictedMeasurement:
    """What a pose predicts of a landmark: range, bearing, and their derivative H (2, 3) by pose."""

    range_m: float
    bearing_rad: float
    jacobian: Floats


def predict_measurement(
    pose: Floats, landmark: LandmarkPosition
) -> tuple[PredictedMeasurement, bool]:
    """Return what a (3,) pose predicts of a landmark, and whether that is defined.

    Undefined where the landmark stands at the robot itself: bearing and H have no limit there. H
    divides twice by the range instead of by its square, which would under- or overflow first.
    """
    dx, dy = landmark.x_m - float(pose[0]), landmark.y_m - float(pose[1])
    rho = math.hypot(dx, dy)
    # The reciprocal of a smaller range overflows: 1 / 2.3e-308 still fits.
    if not np.finfo(np.float64).tiny < rho < math.inf:
        return PredictedMeasurement(0.0, 0.0, np.zeros((2, 3))), False
    cx, cy = dx / rho, dy / rho
    jacobian = np.array([[-cx, -cy, 0.0], [cy / rho, -cx / rho, -1.0]])
    bearing_rad = angle_difference(math.atan2(dy, dx), float(pose[2]))
    return PredictedMeasurement(rho, bearing_rad, jacobian), True


def compute_innovation(
    measurement: Measurement, predicted: PredictedMeasurement
) -> tuple[Floats, Floats, Floats]:
    """Return innovation (n,), H (n, 3) and R (n, n); n = 2, or 1 for a bearing alone.

    The bearing's difference is wrapped.
    """
    turn = angle_difference(measurement.bearing_rad, predicted.bearing_rad)
    if isinstance(measurement, BearingOnly):
        noise = np.array([[measurement.variance_rad2]])
        return np.array([turn]), predicted.jacobian[1:], noise
    innovation = np.array([measurement.range_m - predicted.range_m, turn])
    return innovation, predicted.jacobian, measurement.covariance


def is_finite(measurement: Measurement) -> bool:
    """Return whether every number of a measurement is finite."""
    if isinstance(measurement, BearingOnly):
        return math.isfinite(measurement.bearing_rad) and math.isfinite(measurement.variance_rad2)
    numbers = (measurement.range_m, measurement.bearing_rad)
    return all(map(math.isfinite, numbers)) and bool(np.isfinite(measurement.covariance).all())
