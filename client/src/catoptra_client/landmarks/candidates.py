"""Candidates: sets of blobs that may show a landmark, their ranges, and the detections they become.

A point `drop_m` below the viewpoint (negative: above), at incidence angle theta, lies at the level
range r = drop tan(theta). In t = tan(theta / 2) nothing cancels and the horizon is t = 1 exactly.
At the horizon r is undefined, and the mean of r does not exist near the horizon, so ranges less
than three sigma from the horizon are rejected: functions return (value, valid), and an invalid
value is 0. A detection is a measurement at the viewpoint, moved to the robot's origin.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from catoptra_client.landmarks.blobs import Blob, Viewpoint, robot_from_viewpoint_polar
from catoptra_client.unwarp import CylinderGeometry
from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.derivatives import differentiate_direction
from catoptra_protocol.optics.numerics import Floats, wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import rotation_from_rpy


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
    covariance_m_rad: float = 0.0
    """Covariance of range and azimuth."""


# The mean of drop tan(theta + noise) does not exist; beyond three sigma its bias is bounded.
_HORIZON_SIGMAS = 3.0


def range_from_half_angle(t: float, *, drop_m: float) -> tuple[float, bool]:
    """Level range of a point from t = tan(theta / 2), and whether the range exists.

    Invalid at the horizon, on the side of the horizon opposite to the point, for t < 0, and where
    the range exceeds float64.
    """
    if not (0.0 <= t < math.inf and math.isfinite(drop_m)):
        return 0.0, False
    if t == 1.0 or drop_m == 0.0 or (t > 1.0) != (drop_m < 0.0):
        return 0.0, False
    # Above the horizon in 1 / t, which changes only the sign of tan(theta) and cannot overflow.
    u = t if t < 1.0 else 1.0 / t
    range_m = abs(drop_m) * (2.0 * u / ((1.0 - u) * (1.0 + u)))
    return (range_m, True) if range_m < math.inf else (0.0, False)


def range_from_slope(slope: float, *, drop_m: float) -> tuple[float, bool]:
    """Level range of a point from the slope cot(theta), and whether the range exists.

    Invalid at the horizon (slope 0), on the side of the horizon opposite to the point, and where
    the range exceeds float64.
    """
    if not (math.isfinite(slope) and math.isfinite(drop_m)):
        return 0.0, False
    # Signs are compared, not multiplied: a product of small numbers is 0.
    if slope == 0.0 or drop_m == 0.0 or (slope < 0.0) != (drop_m < 0.0):
        return 0.0, False
    range_m = drop_m / slope
    return (range_m, True) if range_m < math.inf else (0.0, False)


def range_sigma_from_angle(
    *, drop_m: float, range_m: float, sigma_rad: float
) -> tuple[float, bool]:
    """Sigma, in metres, of a level range measured by the depression of a point.

    sigma_r = (drop^2 + r^2) / |drop| sigma_theta. Invalid at the horizon, and where sigma exceeds
    float64.

    Args:
        drop_m: Height of the viewpoint over the point.
        range_m: Level range of the point.
        sigma_rad: Sigma of its angle from the vertical.
    """
    if drop_m == 0.0:
        return 0.0, False
    # Divided between two products: (drop^2 + r^2) overflows where sigma itself does not.
    distance_m = math.hypot(drop_m, range_m)
    sigma_m = distance_m / abs(drop_m) * distance_m * sigma_rad
    return (sigma_m, True) if sigma_m < math.inf else (0.0, False)


def is_clear_of_horizon(*, drop_m: float, range_m: float, sigma_rad: float) -> bool:
    """Whether a point's incidence angle is more than three sigma away from the horizon."""
    return math.atan2(abs(drop_m), range_m) > _HORIZON_SIGMAS * sigma_rad


@dataclass(frozen=True, slots=True)
class CylinderView:
    """Camera, cylinder and viewpoint, which give rows and columns their metric meaning."""

    camera: OmniCamera
    cylinder: CylinderGeometry
    viewpoint: Viewpoint

    def drop_m(self, landmark: Landmark, fraction: float) -> float:
        """Height of the viewpoint over a point of a landmark's band; negative if below.

        Args:
            landmark: the landmark.
            fraction: height in the band, from 0 (lower edge) to 1 (upper edge).
        """
        band_m = landmark.band_top_m - landmark.band_bottom_m
        return self.viewpoint.height_m - (landmark.band_bottom_m + fraction * band_m)

    def azimuth_from_column(self, column: float) -> float:
        """Wrapped azimuth of a column, which may lie beyond the image width."""
        return wrap_angle(self.cylinder.azimuth_from_column(column))

    @np.errstate(under="ignore")  # terms far below 1 may vanish
    def angle_sigmas(
        self, azimuth_rad: float, *, drop_m: float, range_m: float, sigma_px: float
    ) -> tuple[float, float, float, bool]:
        """Sigmas, in radians, of a point's angle from the vertical and of its azimuth, and their
        correlation.

        By the derivatives of the pixel by both angles. Invalid for a point that the camera does not
        show, and straight below the viewpoint, where the azimuth is undefined.

        Args:
            azimuth_rad: Azimuth of the point.
            drop_m: Height of the viewpoint over the point.
            range_m: Level range of the point.
            sigma_px: Sigma of the point's pixel in either direction.

        Returns:
            Both sigmas, the correlation, and validity.
        """
        if range_m == 0.0:
            return 0.0, 0.0, 0.0, False
        distance_m = math.hypot(range_m, drop_m)
        level, down = range_m / distance_m, drop_m / distance_m
        ahead = np.array((math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0))
        across = np.array((-ahead[1], ahead[0], 0.0))
        direction, outwards = level * ahead + (0.0, 0.0, down), down * ahead - (0.0, 0.0, level)
        # Columns: the robot's axes by those of the mirror.
        axes = np.eye(3) if self.viewpoint.rotation is None else self.viewpoint.rotation
        found = differentiate_direction(self.camera, direction @ axes)
        by_angle = found.by_point @ axes.T @ np.stack((outwards, level * across), axis=-1)
        (a, b), (c, d) = by_angle.tolist()
        area, by_down, by_azimuth = abs(a * d - b * c), math.hypot(a, c), math.hypot(b, d)
        if not found.valid or not area > 0.0:
            return 0.0, 0.0, 0.0, False
        down_rad, azimuth_rad = sigma_px * (by_azimuth / area), sigma_px * (by_down / area)
        correlation = -(a / by_down * (b / by_azimuth) + c / by_down * (d / by_azimuth))
        return down_rad, azimuth_rad, correlation, azimuth_rad < math.inf

    def touches_edge(self, blob: Blob) -> bool:
        """Whether a blob touches the upper or lower image edge and may be cut off there."""
        return blob.top <= 0.0 or blob.bottom >= self.cylinder.rows


@dataclass(frozen=True, slots=True)
class Candidate:
    """Landmark that a set of blobs may show."""

    landmark: Landmark
    blobs: tuple[Blob, ...]
    measurement: PolarMeasurement
    """Polar measurement of the landmark from the viewpoint."""
    has_range: bool
    """Whether the range of the measurement is usable."""

    @property
    def num_pixels(self) -> int:
        """Number of pixels of all blobs."""
        return sum(blob.num_pixels for blob in self.blobs)


def detection_from_candidate(candidate: Candidate, viewpoint: Viewpoint) -> Detection:
    """Detection of a candidate, moved from the viewpoint to the robot's origin.

    The covariance is propagated by the Jacobian of the change of origin. Of a candidate without a
    range the approximate range and its sigma serve to move the bearing alone.
    """
    landmark, measurement = candidate.landmark, candidate.measurement
    polar = np.array([measurement.range_m, measurement.azimuth_rad])
    range_m, bearing, jacobian = robot_from_viewpoint_polar(viewpoint, polar)
    root = jacobian * (measurement.range_sigma_m, measurement.azimuth_sigma_rad)
    mixed = measurement.covariance_m_rad * np.outer(jacobian[:, 0], jacobian[:, 1])
    covariance = root @ root.T + mixed + mixed.T
    if not candidate.has_range:
        range_m, covariance = 0.0, np.array(((0.0, 0.0), (0.0, covariance[1, 1])))
    covariance.setflags(write=False)
    return Detection(
        landmark.name,
        landmark.kind,
        range_m,
        bearing,
        covariance,
        candidate.num_pixels,
        candidate.has_range,
    )


def level_detection(
    detection: Detection,
    landmark: Landmark,
    viewpoint: Viewpoint,
    *,
    roll_rad: float,
    pitch_rad: float,
    origin_height_m: float = 0.0,
) -> Detection:
    """Detection of a tilted robot, as a level one at the same place and heading would make it.

    The beacon stands upright on the plane of the wheels. With R = Ry(pitch) Rx(roll), down in axes
    of the robot is g = R^T (0, 0, 1), and the plane's normal in level axes n = R (0, 0, 1). Range r
    and bearing b of a robot taken for level are those of the axis, behind the front of the lower
    band by a = pi / 4 radius, seen from v = (forward, right, -H) at the height h. The bearing is
    that of the middle of both bands, higher by m, which leans sideways: with e = (cos b, sin b, 0)
    and s = (-sin b, cos b, 0) the ray to the front of the lower band is, in level axes,

        d = R ((r - a) e + m (g . s) s - (0, 0, h) - v)

    In its level direction u = (dx, dy, 0) / |(dx, dy)| the axis is a behind the front. A foot h
    below it is on the plane for t = (H - h n_z - a n . u) / (H - h), so that in level axes, from
    the robot's origin o = (0, 0, -origin height), the axis is at

        p = R (v - o) + t d + a u

    Range and bearing are those of x and y of p; their Jacobian is that of t d. Of a detection
    without a range the bearing alone is made level, as of a far point: p = R e.

    Args:
        detection: Detection in the robot's own axes, such as `detect` returns.
        landmark: The detected landmark.
        viewpoint: Viewpoint of the detector.
        roll_rad: Roll of the robot, as an INS reports it; the tilt is below 90 degrees.
        pitch_rad: Pitch, likewise.
        origin_height_m: Distance of the robot's origin from the plane of its wheels.
    """
    rotation = rotation_from_rpy(roll_rad, pitch_rad, 0.0)
    ahead = np.array((math.cos(detection.bearing_rad), math.sin(detection.bearing_rad), 0.0))
    across = np.array((-ahead[1], ahead[0], 0.0))
    point, scale, reach_m = rotation @ ahead, 1.0, 1.0
    if detection.has_range:
        eye = np.array((viewpoint.forward_m, viewpoint.right_m, -viewpoint.height_m))
        origin = np.array((0.0, 0.0, -origin_height_m))
        above_m = 0.25 * (landmark.band_top_m - landmark.band_bottom_m)
        band_m, depth_m = landmark.band_bottom_m + above_m, 0.125 * math.pi * landmark.width_m
        reach_m = detection.range_m - depth_m
        lean = above_m * (rotation[2] @ across) * across
        ray = rotation @ (reach_m * ahead + lean - (0.0, 0.0, band_m) - eye)
        level = np.array((ray[0], ray[1], 0.0)) / math.hypot(ray[0], ray[1])
        normal, height_m = rotation[:, 2], viewpoint.height_m
        scale = (height_m - band_m * normal[2] - depth_m * (normal @ level)) / (height_m - band_m)
        point = rotation @ (eye - origin) + scale * ray + depth_m * level
    x, y, _ = point.tolist()
    range_m = math.hypot(x, y)
    by_point = np.array(((x, y), (-y / range_m, x / range_m))) / range_m
    by_polar = scale * (rotation @ np.stack((ahead, reach_m * across), axis=-1))[:2]
    jacobian = by_point @ by_polar
    if not detection.has_range:
        range_m, jacobian = 0.0, np.diag((0.0, jacobian[1, 1]))
    covariance = jacobian @ detection.covariance @ jacobian.T
    covariance.setflags(write=False)
    return replace(detection, range_m=range_m, bearing_rad=math.atan2(y, x), covariance=covariance)


def require_distinct_colours(landmarks: Iterable[Landmark]) -> None:
    """Check that colours identify each landmark.

    Raises:
        DomainError: two landmarks share kind and colours, or a beacon has one colour only.
    """
    seen: dict[tuple[str, str, str], str] = {}
    for landmark in landmarks:
        appearance = (landmark.kind, landmark.lower_colour, landmark.upper_colour)
        if appearance in seen:
            raise DomainError(
                f"{landmark.name} and {seen[appearance]} are both a {' '.join(appearance)}: "
                "colours do not distinguish them"
            )
        if landmark.kind == "beacon" and landmark.lower_colour == landmark.upper_colour:
            raise DomainError(
                f"{landmark.name}: a beacon of one colour cannot be distinguished from noise"
            )
        seen[appearance] = landmark.name
