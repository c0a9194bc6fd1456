"""What a camera sees, and how finely: numbers that follow from the camera model alone.

Angles are from the optical axis. Resolutions are those before the stretch of the image plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

_NUM_AZIMUTHS = 360
_NUM_RINGS = 360
# Halvings of an interval of half a degree: below 1e-9 degrees.
_NUM_HALVINGS = 30
# A direction so close to the axis counts as the axis: 1e-6 degrees.
_AXIS_RAD = 2e-8


def _ring_directions(theta_rad: Floats, azimuth_rad: Floats) -> Floats:
    """(..., 3) directions at angles from the axis, in the mirror frame."""
    sine = np.sin(theta_rad)
    return np.stack(
        np.broadcast_arrays(
            sine * np.cos(azimuth_rad), sine * np.sin(azimuth_rad), np.cos(theta_rad)
        ),
        axis=-1,
    )


def _visible_fraction(camera: OmniCamera, theta_rad: Floats) -> Floats:
    """Fractions of the azimuths at which the image shows an angle; shaped like the angles."""
    azimuth = 2.0 * math.pi * (np.arange(_NUM_AZIMUTHS) + 0.5) / _NUM_AZIMUTHS
    _, is_shown = _pixels_in_image(camera, _ring_directions(theta_rad[..., None], azimuth))
    fraction: Floats = is_shown.mean(axis=-1)
    return fraction


def _pixels_in_image(camera: OmniCamera, direction: Floats) -> tuple[Floats, Bools]:
    """(..., 2) pixels of directions, and whether rim and borders of the image let these be seen."""
    pixel, valid = camera.pixel_from_direction(direction)
    # An inscribed rim touches the borders up to rounding.
    size = np.array([camera.width_px, camera.height_px])
    slack_px = 1e-6
    inside = np.all((pixel >= -slack_px) & (pixel <= size + slack_px), axis=-1)
    return pixel, valid & inside


def ring_pixels(camera: OmniCamera, theta_rad: float) -> Floats:
    """(361, 2) pixels of the circle of one angle; nan where the image ends."""
    azimuth = np.linspace(0.0, 2.0 * math.pi, 361)
    pixel, is_shown = _pixels_in_image(camera, _ring_directions(np.array(theta_rad), azimuth))
    return np.where(is_shown[:, None], pixel, math.nan)


def covered_sphere(camera: OmniCamera) -> float:
    """Fraction of the sphere of directions that the image shows."""
    # Rings that end at the rim exactly: the sum has no error where the image shows the whole rim.
    edges = np.linspace(min_angle_rad(camera), camera.rim_rad, _NUM_RINGS + 1)
    fraction = _visible_fraction(camera, 0.5 * (edges[1:] + edges[:-1]))
    return float(fraction @ -np.diff(np.cos(edges))) / 2.0


def min_angle_rad(camera: OmniCamera) -> float:
    """Smallest angle from the axis in the image: 0 but for a cone."""
    return 2.0 * math.atan(camera.projection.t_min)


def resolution_at(camera: OmniCamera, theta_rad: float) -> tuple[float, float]:
    """Pixels per degree along and across the image radius at an angle from the axis.

    Both are nan where the image has no azimuth of the ring.
    """
    theta = np.array([theta_rad])
    is_modelled = min_angle_rad(camera) <= theta_rad <= camera.rim_rad
    if not is_modelled or _visible_fraction(camera, np.maximum(theta, _AXIS_RAD))[0] == 0.0:
        return math.nan, math.nan
    radial, tangential = resolution_curve(camera, theta)
    return float(radial[0]), float(tangential[0])


def resolution_curve(camera: OmniCamera, theta_rad: Floats) -> tuple[Floats, Floats]:
    """Pixels per degree along and across the image radius, (n,) each.

    Args:
        camera: Camera model.
        theta_rad: (n,) angles between the smallest one and the rim, below 180 degrees.
    """
    t = np.tan(0.5 * theta_rad)
    radial = camera.radius_slope_px(t)
    on_axis = theta_rad < _AXIS_RAD
    # r / sin(theta) is 0 / 0 on the axis, where both scales are equal.
    sine = np.where(on_axis, 1.0, np.sin(theta_rad))
    tangential = np.where(on_axis, radial, camera.radius_px_from_t(t) / sine)
    return np.radians(radial), np.radians(tangential)


def floor_view(camera: OmniCamera, height_m: float) -> tuple[float, float]:
    """Ring of the floor that a camera looking straight down shows in all directions.

    By the model alone: what the robot hides is known by labels (`CameraStage.hidden_floor_m`).

    Args:
        camera: Camera model; of a non-central one, its central approximation.
        height_m: Height of the viewpoint above the floor.

    Returns:
        Radius of the circle below the camera that is not seen, inf without any floor; and the
        distance to which the floor is seen, inf with the horizon, 0 without any floor.
    """
    grid = np.radians(np.arange(0.0, 90.01, 0.5))
    grid[0] = _AXIS_RAD
    seen = _visible_fraction(camera, grid) == 1.0
    if not seen.any():
        return math.inf, 0.0
    first = int(np.argmax(seen))
    last = first + int(np.argmin(np.append(seen[first:], False))) - 1

    def sees_angle(theta_rad: float) -> bool:
        return float(_visible_fraction(camera, np.array(theta_rad))) == 1.0

    low = 0.0 if first == 0 else _bisect(sees_angle, inside=grid[first], outside=grid[first - 1])
    if last == len(grid) - 1:
        return height_m * math.tan(low), math.inf
    high = _bisect(sees_angle, inside=grid[last], outside=grid[last + 1])
    return height_m * math.tan(low), height_m * math.tan(high)


def _bisect(sees_angle: Callable[[float], bool], *, inside: float, outside: float) -> float:
    """Angle at which visibility ends between one that is seen and one that is not."""
    for _ in range(_NUM_HALVINGS):
        middle = 0.5 * (inside + outside)
        if sees_angle(middle):
            inside = middle
        else:
            outside = middle
    return inside
