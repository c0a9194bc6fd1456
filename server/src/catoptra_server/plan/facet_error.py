"""How far a polygon mirror shows things from their place: computed on its facets, in float64.

On a facet everything is known in closed form: a place on it, the pixel that the capture camera sees
it in, the direction that is interpolated there, and where the camera law puts that direction. The
distance of the two is the error. It is evaluated on a grid of each triangle, borders included, and
only in the sectors that the mesh and the cube do not repeat.

From a grid to a bound: the error vanishes at the corners, and in between it is a quadratic form
sum a_ij w_i w_j of the barycentric weights, up to terms that fall with the next power of the
facet's size. What a linear interpolation between grid places 1/k apart leaves of such a form is the
same form again, k^2 times smaller. So the largest error of all is at most that of the grid divided
by 1 - 1/k^2. What is not quadratic, such as the kinks where a coarse facet looks past the mirror's
asymptote, is of first order in 1/k and by a facet's angle smaller: pi / S of 1/k is added for it.
Source of the quadratic: optics notes, 3.1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera import OmniCamera, half_angle_tangent
from catoptra_protocol.optics.image_scale import shows_whole_rim
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.plan.geometric_error import GeometricError
from catoptra_server.scene.mirror_mesh import Interpolation, PolygonSplit, mirror_mesh

# Finest first; even, as the quadrature needs. 2 x 2 steps overstate the error by a third.
_STEPS = (32, 16, 8, 6, 4, 2)
# Places that are evaluated, at most: 20 ms, and 64 x 64 polygons still get 8 steps.
_MOST_PLACES = 120_000
# A facet may show directions beyond the rim. They belong where the mirror's law goes on; beyond its
# asymptote there is no such place, and the last one stands for all.
_OF_ASYMPTOTE = 0.999
_HIGHEST_RAD = math.radians(178.0)


@lru_cache(maxsize=256)
def facet_error(camera: OmniCamera, split: PolygonSplit) -> GeometricError:
    """Return the error over the pixels that the polygons cover.

    Raises DomainError for an orthographic camera: polygons are seen from a pinhole.
    """
    if not math.isfinite(camera.mirror.pinhole_m):
        raise DomainError("a polygon mirror needs a capture camera with a pinhole")
    corners, directions = _distinct_triangles(camera, split)
    steps = _steps_for(len(corners))
    weights, quadrature = _triangle_grid(steps)
    seen = _seen_places(camera, weights @ corners, steps)
    looked_up = weights @ directions
    # An image area: the projection of a flat triangle has the density det / depth^3.
    area = np.abs(np.linalg.det(_from_pinhole(camera, corners)))[:, None] / seen.depth_m**3
    area = area * quadrature * seen.within
    error_px = _distance_px(camera, seen.place_px, looked_up)
    error_rad = _angle_rad(camera, seen.place_px, looked_up)
    reserve = (1.0 + math.pi / split.sectors / steps) / (1.0 - 1.0 / steps**2)
    return GeometricError(
        max_px=reserve * float(error_px[seen.near].max()),
        rms_px=_rms(error_px, area),
        max_deg=reserve * math.degrees(float(error_rad[seen.near].max())),
        rms_deg=math.degrees(_rms(error_rad, area)),
    )


def rim_gap(camera: OmniCamera, split: PolygonSplit) -> GeometricError:
    """Return how far within the rim the polygons end: in the middle of their outer borders."""
    radius_px = camera.rim_radius_px
    chord_px = radius_px * math.cos(math.pi / split.sectors)
    # 1 - cos in a form that does not cancel for many sectors.
    gap_px = 2.0 * radius_px * math.sin(0.5 * math.pi / split.sectors) ** 2
    t = camera.mirror.t_from_radius_ratio(np.array(chord_px / camera.horizon_radius_px))
    gap_deg = math.degrees(camera.rim_rad - 2.0 * math.atan(float(t)))
    return GeometricError(gap_px, 0.0, gap_deg, 0.0)


def _distinct_triangles(camera: OmniCamera, split: PolygonSplit) -> tuple[Floats, Floats]:
    """Return (n, 3, 3) corners and looked-up directions of the sectors that are not repeated."""
    mesh = mirror_mesh(camera, split)
    polygon = np.concatenate((np.arange(split.polygons), np.arange(split.sectors, split.polygons)))
    chosen = polygon % split.sectors < _distinct_sectors(camera, split)
    return mesh.corners[chosen], mesh.directions[chosen]


def _distinct_sectors(camera: OmniCamera, split: PolygonSplit) -> int:
    """Return how many sectors repeat: by any turn of the mirror, or by quarter turns of the cube.

    Borders of the image cut into one sector as not into another.
    """
    if not shows_whole_rim(camera):
        return split.sectors
    if split.interpolation is Interpolation.POSITION:
        return 1
    return split.sectors // math.gcd(split.sectors, 4)


def _steps_for(triangles: int) -> int:
    """Return the finest steps along a triangle's side that can be afforded."""
    fitting = (k for k in _STEPS if triangles * (k + 1) * (k + 2) // 2 <= _MOST_PLACES)
    return next(fitting, _STEPS[-1])


@lru_cache(maxsize=len(_STEPS))
def _triangle_grid(steps: int) -> tuple[Floats, Floats]:
    """Return (q, 3) barycentric weights of a grid with its borders, and its (q,) quadrature.

    The quadrature is the rule of the three side middles, exact for quadratics, on triangles of two
    steps: places with two even indices weigh nothing, those on a border half.
    """
    i, j = np.nonzero(np.add.outer(np.arange(steps + 1), np.arange(steps + 1)) <= steps)
    weights = np.stack((i, j, steps - i - j), axis=-1)
    middles = (weights % 2 != 0).any(axis=-1)
    quadrature = middles * np.where((weights == 0).any(axis=-1), 0.5, 1.0)
    return weights / steps, quadrature


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Where the capture camera sees places on facets; (n, q) arrays, q places a triangle.

    place_px: (n, q, 2) from the image centre, along the mirror frame's x and y. depth_m: from the
    pinhole along the axis. within: in the image. near: no farther from it than a grid step.
    """

    place_px: Floats
    depth_m: Floats
    within: Bools
    near: Bools


def _seen_places(camera: OmniCamera, places: Floats, steps: int) -> _Seen:
    """Return where (n, q, 3) places are seen, with q of a grid of so many steps."""
    x, y, depth = np.moveaxis(_from_pinhole(camera, places), -1, 0)
    rim_r, rim_z = camera.mirror.surface(np.array(camera.rim_t))
    focal_px = camera.rim_radius_px * (camera.mirror.pinhole_m - float(rim_z)) / float(rim_r)
    place_px = np.stack((x, y), axis=-1) * (focal_px / depth)[..., None]
    if shows_whole_rim(camera):
        everywhere = np.ones(depth.shape, dtype=np.bool_)
        return _Seen(place_px, depth, everywhere, everywhere)
    extent_px = np.ptp(place_px, axis=1).max(axis=-1, keepdims=True)
    # A step of a diagonal; no place of the image is farther from the grid.
    margin_px = math.sqrt(2.0) * extent_px / steps
    near = _within_image(camera, place_px, margin_px)
    return _Seen(place_px, depth, _within_image(camera, place_px, np.zeros(1)), near)


def _from_pinhole(camera: OmniCamera, places: Floats) -> Floats:
    """Return (..., 3) places as (x, y, depth): the depth grows from the pinhole to the mirror."""
    return places * (1.0, 1.0, -1.0) + (0.0, 0.0, camera.mirror.pinhole_m)


def _within_image(camera: OmniCamera, place_px: Floats, margin_px: Floats) -> Bools:
    """Return which (n, q, 2) places from the image centre lie in the image, or (n, 1) px beside."""
    cos_up, sin_up = math.cos(camera.up_azimuth_rad), math.sin(camera.up_azimuth_rad)
    x, y = np.moveaxis(place_px, -1, 0)
    u = camera.centre_px[0] + sin_up * x - cos_up * y
    v = camera.centre_px[1] - cos_up * x - sin_up * y
    inside_u = (u >= -margin_px) & (u <= camera.width_px + margin_px)
    inside_v = (v >= -margin_px) & (v <= camera.height_px + margin_px)
    within: Bools = inside_u & inside_v
    return within


def _distance_px(camera: OmniCamera, place_px: Floats, looked_up: Floats) -> Floats:
    """Return the (n, q) distances from places to where (n, q, 3) directions belong."""
    asymptote_rad = 2.0 * math.atan(camera.mirror.t_limit)
    t, _ = half_angle_tangent(looked_up)
    t = np.minimum(t, math.tan(0.5 * min(_OF_ASYMPTOTE * asymptote_rad, _HIGHEST_RAD)))
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
    rho = np.hypot(looked_up[..., 0], looked_up[..., 1])
    belongs_px = looked_up[..., :2] * (radius_px / np.where(rho > 0.0, rho, 1.0))[..., None]
    distance_px: Floats = np.linalg.norm(belongs_px - place_px, axis=-1)
    return distance_px


def _angle_rad(camera: OmniCamera, place_px: Floats, looked_up: Floats) -> Floats:
    """Return the (n, q) angles between what places show and what the law shows there."""
    ratio = np.hypot(place_px[..., 0], place_px[..., 1]) / camera.horizon_radius_px
    t = camera.mirror.t_from_radius_ratio(ratio)
    level = place_px * (2.0 * t / np.where(ratio > 0.0, ratio, 1.0))[..., None]
    level /= camera.horizon_radius_px
    by_law = np.concatenate((level, ((1.0 - t) * (1.0 + t))[..., None]), axis=-1)
    by_law /= (1.0 + np.square(t))[..., None]
    unit = looked_up / np.linalg.norm(looked_up, axis=-1, keepdims=True)
    # The chord keeps its precision for small angles, which the cosine does not.
    chord = np.linalg.norm(unit - by_law, axis=-1)
    angle: Floats = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    return angle


def _rms(values: Floats, weight: Floats) -> float:
    return math.sqrt(float((np.square(values) * weight).sum() / weight.sum()))
