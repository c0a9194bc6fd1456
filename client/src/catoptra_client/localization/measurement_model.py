"""Measurement model: range and bearing of a landmark (Schmits & Visser 2009, Eq. 6).

The bearing gamma is relative to the robot's heading and positive to the right (x towards y), as
yaw. A landmark near the horizon has no usable range and gives a bearing alone.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.detection import Detection
from catoptra_client.localization.landmark_map import LandmarkPosition
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats, angle_difference


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
    return all(map(math.isfinite, numbers)) and bool(np.isfinite(measurement.covariance).all())
