"""Detections: from a measurement at the viewpoint to one at the robot's origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.viewpoint import Viewpoint, robot_from_viewpoint_polar
from catoptra_protocol.optics.numerics import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """Detected landmark, as measured from the robot's origin."""

    name: str
    """Name in the landmark file."""
    kind: str
    """Kind in the landmark file: beacon or goal."""
    range_m: float
    """Level range; 0 without `has_range`."""
    bearing_rad: float
    """Bearing from the robot's x axis, positive to the right."""
    covariance: Floats
    """Covariance (2, 2) of (range, bearing), m^2 and rad^2; 0 for a range without `has_range`."""
    num_pixels: int
    """Number of cylinder pixels in the landmark's blobs."""
    has_range: bool
    """Whether range and covariance of the range are defined."""


@dataclass(frozen=True, slots=True)
class PolarMeasurement:
    """Point in polar coordinates around the viewpoint, with standard deviations."""

    range_m: float
    """Level range from the viewpoint."""
    azimuth_rad: float
    """Azimuth in the mirror frame, from x towards y."""
    range_sigma_m: float
    azimuth_sigma_rad: float


def detection_from_measurement(
    name: str, kind: str, measurement: PolarMeasurement, *, viewpoint: Viewpoint, num_pixels: int
) -> Detection:
    """Move a measurement with a range from the viewpoint to the robot's origin.

    The covariance is propagated by the Jacobian of the change of origin.
    """
    polar = np.array([measurement.range_m, measurement.azimuth_rad])
    range_m, bearing, jacobian = robot_from_viewpoint_polar(viewpoint, polar)
    variances = np.square([measurement.range_sigma_m, measurement.azimuth_sigma_rad])
    covariance = (jacobian * variances) @ jacobian.T
    return Detection(name, kind, range_m, bearing, _freeze(covariance), num_pixels, True)


def bearing_detection_from_measurement(
    name: str, kind: str, measurement: PolarMeasurement, *, viewpoint: Viewpoint, num_pixels: int
) -> Detection:
    """Detection without a range, from a measurement whose range is only approximate.

    The approximate range and its sigma serve to move the bearing from the viewpoint to the robot's
    origin.
    """
    approximate = detection_from_measurement(
        name, kind, measurement, viewpoint=viewpoint, num_pixels=num_pixels
    )
    covariance = np.diag([0.0, float(approximate.covariance[1, 1])])
    return Detection(
        name, kind, 0.0, approximate.bearing_rad, _freeze(covariance), num_pixels, False
    )


def _freeze(array: Floats) -> Floats:
    array.setflags(write=False)
    return array
