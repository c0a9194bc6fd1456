"""Distance bounds of boxes and planes in the rings of an image, bands of equal image radius.

A ring of the image is a band of angles theta about the optical axis, at any azimuth. So a
box counts as the solid of revolution that the box sweeps about the axis: a rectangle of (rho, z).
The rectangle's nearest point within a band is its nearest point to the viewpoint, if in the band,
or lies on one of the band's two borders. Every value is a lower bound.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.scene_summary import NUM_RINGS

# Boxes grow by this fraction of their distance on all sides: frames are rendered in float32, so a
# surface just beside a ring can appear in the ring. Some 0.003 px at 640 px.
_RELATIVE_PADDING = 1e-5
# Replaces a sine or cosine of 0: axis and horizon are borders of bands.
_MIN_DIVISOR = 1e-18


@dataclass(frozen=True, slots=True, eq=False)
class ImageRings:
    """Borders of a camera's rings, from the axis to the rim; (NUM_RINGS + 1,) each."""

    edges_rad: Floats
    """Incidence angles."""
    inverse_sines: Floats
    """1 / sin of them, finite on the axis."""
    inverse_cosines: Floats
    """1 / cos of them, finite at the horizon."""


@lru_cache(maxsize=16)
def image_rings(camera: RadialCamera) -> ImageRings:
    """Rings of a camera by its exact projection; a mesh may show a direction in the next ring."""
    radius_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    t = camera.t_from_radius_px(radius_px)
    edges_rad = 2.0 * np.arctan(t)
    cosines = np.cos(edges_rad)
    return ImageRings(
        edges_rad,
        inverse_sines=1.0 / np.maximum(np.sin(edges_rad), _MIN_DIVISOR),
        inverse_cosines=1.0 / np.where(np.abs(cosines) < _MIN_DIVISOR, _MIN_DIVISOR, cosines),
    )


def box_distance_bounds(low: Floats, high: Floats, rings: ImageRings) -> Floats:
    """Distance within which each ring shows nothing of a box; inf: none of the box in the ring.

    Args:
        low: (n, 3) lower corners from the viewpoint, in axes whose z is the optical axis.
        high: (n, 3) upper corners.

    Returns:
        (n, NUM_RINGS) metres.
    """
    near = np.maximum(np.maximum(low, -high), 0.0)
    far = np.maximum(-low, high)
    rho_high = np.hypot(far[:, 0], far[:, 1])
    pad = _RELATIVE_PADDING * (rho_high + far[:, 2])
    rho_low = np.maximum(np.hypot(near[:, 0], near[:, 1]) - pad, 0.0)
    return _rectangle_distance_bounds(
        (rho_low, rho_high + pad), (low[:, 2] - pad, high[:, 2] + pad), rings
    )


def _rectangle_distance_bounds(
    rho: tuple[Floats, Floats], z: tuple[Floats, Floats], rings: ImageRings
) -> Floats:
    """(n, NUM_RINGS) distances of (rho, z) rectangles, each given from low to high."""
    # The z of the rectangle nearest to 0.
    level = np.maximum(z[0], 0.0) + np.minimum(z[1], 0.0)
    direct = np.hypot(rho[0], level)[:, None]
    theta = np.arctan2(rho[0], level)[:, None]
    edges = rings.edges_rad
    inside = (edges[:-1] <= theta) & (theta <= edges[1:])
    # Along a border the ray is (r sin theta, r cos theta): r at the rectangle's four sides.
    z_low, z_high = (border[:, None] * rings.inverse_cosines for border in z)
    enter = np.maximum(rho[0][:, None] * rings.inverse_sines, np.minimum(z_low, z_high))
    leave = np.minimum(rho[1][:, None] * rings.inverse_sines, np.maximum(z_low, z_high))
    enter = np.maximum(enter, 0.0)
    on_edge = np.where(enter <= leave, enter, np.inf)
    bounds: Floats = np.minimum(on_edge[:, :-1], on_edge[:, 1:])
    return np.where(inside, direct, bounds)


def plane_distance_bounds(distance: Floats, cosine: Floats, rings: ImageRings) -> Floats:
    """Distance within which each ring shows nothing that lies behind a plane.

    Args:
        distance: (n,) distances of the planes from the viewpoint; 0 for a viewpoint perhaps behind.
        cosine: (n,) cosines of the angle between the axis and the normals away from the viewpoint.

    Returns:
        (n, NUM_RINGS) metres.
    """
    # The point of a plane nearest along a ray at angle a from the normal is at d / cos a; a ring is
    # a range of such angles.
    tilt = np.arccos(np.clip(cosine, -1.0, 1.0))[:, None]
    edges = rings.edges_rad
    angle = np.maximum(
        np.maximum(edges[:-1] - tilt, tilt - edges[1:]) - 2.0 * _RELATIVE_PADDING, 0.0
    )
    facing = np.cos(angle)
    bounds = np.where(facing > 0.0, distance[:, None] / np.maximum(facing, _MIN_DIVISOR), np.inf)
    return np.where(distance[:, None] > 0.0, (1.0 - _RELATIVE_PADDING) * bounds, 0.0)
