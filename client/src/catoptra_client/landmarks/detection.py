"""What a detected landmark is: from a sighting at the viewpoint to one at the robot's origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.viewpoint import Viewpoint, robot_from_viewpoint_polar
from catoptra_protocol.optics.numerics import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A landmark seen from the robot's origin.

    name, kind: of the landmark file. bearing_rad: positive to the right. covariance (2, 2) of
    (range, bearing), m^2 and rad^2. pixels: of the cylinder, that were used. Without `has_range`
    range_m and its row and column of the covariance are 0 and mean nothing.
    """

    name: str
    kind: str
    range_m: float
    bearing_rad: float
    covariance: Floats
    num_pixels: int
    has_range: bool


@dataclass(frozen=True, slots=True)
class PolarMeasurement:
    """A point seen from the viewpoint: level range, azimuth, their sigmas, the height it is at."""

    range_m: float
    azimuth_rad: float
    range_sigma_m: float
    azimuth_sigma_rad: float


def detection_from_measurement(
    name: str, kind: str, measurement: PolarMeasurement, *, viewpoint: Viewpoint, num_pixels: int
) -> Detection:
    """Return a sighting with a range as a detection seen from the robot's origin."""
    polar = np.array([measurement.range_m, measurement.azimuth_rad])
    range_m, bearing, jacobian = robot_from_viewpoint_polar(viewpoint, polar)
    variances = np.square([measurement.range_sigma_m, measurement.azimuth_sigma_rad])
    covariance = jacobian @ np.diag(variances) @ jacobian.T
    return Detection(name, kind, range_m, bearing, _freeze(covariance), num_pixels, True)


def bearing_detection_from_measurement(
    name: str, kind: str, measurement: PolarMeasurement, *, viewpoint: Viewpoint, num_pixels: int
) -> Detection:
    """Return a sighting whose range is only a guess as a bearing alone.

    The guess serves to move the bearing from the viewpoint to the robot's origin, with its own
    uncertainty.
    """
    guess = detection_from_measurement(
        name, kind, measurement, viewpoint=viewpoint, num_pixels=num_pixels
    )
    covariance = np.diag([0.0, float(guess.covariance[1, 1])])
    return Detection(name, kind, 0.0, guess.bearing_rad, _freeze(covariance), num_pixels, False)


def _freeze(array: Floats) -> Floats:
    array.setflags(write=False)
    return array
