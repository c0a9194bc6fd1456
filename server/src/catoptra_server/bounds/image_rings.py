"""How near a box or a plane can be in each ring of the image: bounds by ring of equal image radius.

A ring of the image is a band of incidence angles theta about the mirror's axis, whatever the
azimuth. So a box counts as the ring-shaped body that it fills when it is turned about the axis: a
rectangle of (rho, z), whose nearest point in a band is its nearest point to the viewpoint, if that
lies in the band, or lies on one of the band's two borders. Everything is a lower bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.scene_summary import NUM_RINGS

# Boxes grow by this share of their distance on all sides: what is just beside a ring counts for it,
# since pictures are drawn with the precision of float32. At 640 px it is some 0.003 px.
_RELATIVE_PADDING = 1e-5
# Stands for a sine or cosine of 0: the axis and the horizon are borders of bands.
_MIN_DIVISOR = 1e-18


@dataclass(frozen=True, slots=True, eq=False)
class ImageRings:
    """The incidence angles between a camera's rings, (RINGS + 1,), from 0 to the rim."""

    edges_rad: Floats
    inverse_sines: Floats
    inverse_cosines: Floats


@lru_cache(maxsize=16)
def image_rings(camera: OmniCamera) -> ImageRings:
    """Return the rings of a camera, by its law: polygons may show what is a ring's neighbour."""
    radius_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    t = camera.mirror.t_from_radius_ratio(radius_px / camera.horizon_radius_px)
    edges_rad = 2.0 * np.arctan(t)
    cosines = np.cos(edges_rad)
    return ImageRings(
        edges_rad,
        inverse_sines=1.0 / np.maximum(np.sin(edges_rad), _MIN_DIVISOR),
        inverse_cosines=1.0 / np.where(np.abs(cosines) < _MIN_DIVISOR, _MIN_DIVISOR, cosines),
    )


def box_distance_bounds(low: Floats, high: Floats, rings: ImageRings) -> Floats:
    """Return (n, RINGS) distances within which a ring shows nothing of n boxes; inf: none of it.

    low, high: (n, 3) of the boxes, from the viewpoint, in axes whose z is the mirror's axis.
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
    """Return (n, RINGS) least distances of rectangles of (rho, z), each given from low to high."""
    level = np.maximum(z[0], 0.0) + np.minimum(z[1], 0.0)  # the z that is nearest to 0
    direct = np.hypot(rho[0], level)[:, None]
    theta = np.arctan2(rho[0], level)[:, None]
    edges = rings.edges_rad
    inside = (edges[:-1] <= theta) & (theta <= edges[1:])
    one, other = (border[:, None] * rings.inverse_cosines for border in z)
    enter = np.maximum(rho[0][:, None] * rings.inverse_sines, np.minimum(one, other))
    leave = np.minimum(rho[1][:, None] * rings.inverse_sines, np.maximum(one, other))
    enter = np.maximum(enter, 0.0)
    on_edge = np.where(enter <= leave, enter, np.inf)
    bounds: Floats = np.minimum(on_edge[:, :-1], on_edge[:, 1:])
    return np.where(inside, direct, bounds)


def plane_distance_bounds(distance: Floats, cosine: Floats, rings: ImageRings) -> Floats:
    """Return (n, RINGS) distances within which a ring shows nothing of what lies behind n planes.

    distance: (n,) of the planes from the viewpoint, 0 where it may lie behind one itself. cosine:
    (n,) of the angle between their normals, away from the viewpoint, and the axis.
    """
    tilt = np.arccos(np.clip(cosine, -1.0, 1.0))[:, None]
    edges = rings.edges_rad
    off = np.maximum(np.maximum(edges[:-1] - tilt, tilt - edges[1:]) - 2.0 * _RELATIVE_PADDING, 0.0)
    facing = np.cos(off)
    bounds = np.where(facing > 0.0, distance[:, None] / np.maximum(facing, _MIN_DIVISOR), np.inf)
    return np.where(distance[:, None] > 0.0, (1.0 - _RELATIVE_PADDING) * bounds, 0.0)
