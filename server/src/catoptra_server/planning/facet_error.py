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
from catoptra_protocol.optics.image_scale import shows_whole_rim
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, half_angle_tangent
from catoptra_server.planning.geometric_error import GeometricError
from catoptra_server.scene.mirror_mesh import Interpolation, Tessellation, build_mirror_mesh

# Finest first; even, as the quadrature needs. 2 x 2 steps overstate the error by a third.
_STEP_COUNTS = (32, 16, 8, 6, 4, 2)
# Places that are evaluated, at most: 20 ms, and 64 x 64 polygons still get 8 steps.
_MAX_GRID_POINTS = 120_000
# A facet may show directions beyond the rim. They belong where the mirror's law goes on; beyond its
# asymptote there is no such place, and the last one stands for all.
_ASYMPTOTE_FRACTION = 0.999
_MAX_INCIDENCE_RAD = math.radians(178.0)


@lru_cache(maxsize=256)
def facet_error(camera: OmniCamera, tessellation: Tessellation) -> GeometricError:
    """Return the error over the pixels that the polygons cover.

    Raises DomainError for an orthographic camera: polygons are seen from a pinhole.
    """
    if not math.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("a polygon mirror needs a capture camera with a pinhole")
    corners, directions = _distinct_triangles(camera, tessellation)
    steps = _grid_steps(len(corners))
    weights, quadrature = _triangle_grid(steps)
    seen = _project_points(camera, weights @ corners, steps)
    looked_up = weights @ directions
    # An image area: the projection of a flat triangle has the density det / depth^3.
    area = np.abs(np.linalg.det(_pinhole_coordinates(camera, corners)))[:, None] / seen.depth_m**3
    area = area * quadrature * seen.is_in_image
    error_px = _displacement_px(camera, seen.point_px, looked_up)
    error_rad = _displacement_rad(camera, seen.point_px, looked_up)
    reserve = (1.0 + math.pi / tessellation.sectors / steps) / (1.0 - 1.0 / steps**2)
    return GeometricError(
        max_px=reserve * float(error_px[seen.is_near_image].max()),
        rms_px=_weighted_rms(error_px, area),
        max_deg=reserve * math.degrees(float(error_rad[seen.is_near_image].max())),
        rms_deg=math.degrees(_weighted_rms(error_rad, area)),
    )


def rim_gap(camera: OmniCamera, tessellation: Tessellation) -> GeometricError:
    """Return how far within the rim the polygons end: in the middle of their outer borders."""
    radius_px = camera.rim_radius_px
    chord_px = radius_px * math.cos(math.pi / tessellation.sectors)
    # 1 - cos in a form that does not cancel for many sectors.
    gap_px = 2.0 * radius_px * math.sin(0.5 * math.pi / tessellation.sectors) ** 2
    t = camera.mirror.t_from_radius_ratio(np.array(chord_px / camera.horizon_radius_px))
    gap_deg = math.degrees(camera.rim_rad - 2.0 * math.atan(float(t)))
    return GeometricError(gap_px, 0.0, gap_deg, 0.0)


def _distinct_triangles(camera: OmniCamera, tessellation: Tessellation) -> tuple[Floats, Floats]:
    """Return (n, 3, 3) corners and looked-up directions of the sectors that are not repeated."""
    mesh = build_mirror_mesh(camera, tessellation)
    polygon = np.concatenate(
        (
            np.arange(tessellation.num_polygons),
            np.arange(tessellation.sectors, tessellation.num_polygons),
        )
    )
    chosen = polygon % tessellation.sectors < _num_distinct_sectors(camera, tessellation)
    return mesh.corners[chosen], mesh.directions[chosen]


def _num_distinct_sectors(camera: OmniCamera, tessellation: Tessellation) -> int:
    """Return how many sectors repeat: by any turn of the mirror, or by quarter turns of the cube.

    Borders of the image cut into one sector as not into another.
    """
    if not shows_whole_rim(camera):
        return tessellation.sectors
    if tessellation.interpolation is Interpolation.POSITION:
        return 1
    return tessellation.sectors // math.gcd(tessellation.sectors, 4)


def _grid_steps(num_triangles: int) -> int:
    """Return the finest steps along a triangle's side that can be afforded."""
    fitting = (
        k for k in _STEP_COUNTS if num_triangles * (k + 1) * (k + 2) // 2 <= _MAX_GRID_POINTS
    )
    return next(fitting, _STEP_COUNTS[-1])


@lru_cache(maxsize=len(_STEP_COUNTS))
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
class _ProjectedPoints:
    """Where the capture camera sees places on facets; (n, q) arrays, q places a triangle.

    place_px: (n, q, 2) from the image centre, along the mirror frame's x and y. depth_m: from the
    pinhole along the axis. within: in the image. near: no farther from it than a grid step.
    """

    point_px: Floats
    depth_m: Floats
    is_in_image: Bools
    is_near_image: Bools


def _project_points(camera: OmniCamera, points: Floats, steps: int) -> _ProjectedPoints:
    """Return where (n, q, 3) places are seen, with q of a grid of so many steps."""
    x, y, depth = np.moveaxis(_pinhole_coordinates(camera, points), -1, 0)
    rim_r, rim_z = camera.mirror.surface_point(np.array(camera.rim_t))
    focal_px = (
        camera.rim_radius_px * (camera.mirror.pinhole_distance_m - float(rim_z)) / float(rim_r)
    )
    place_px = np.stack((x, y), axis=-1) * (focal_px / depth)[..., None]
    if shows_whole_rim(camera):
        everywhere = np.ones(depth.shape, dtype=np.bool_)
        return _ProjectedPoints(place_px, depth, everywhere, everywhere)
    extent_px = np.ptp(place_px, axis=1).max(axis=-1, keepdims=True)
    # A step of a diagonal; no place of the image is farther from the grid.
    margin_px = math.sqrt(2.0) * extent_px / steps
    near = _is_in_image(camera, place_px, margin_px)
    return _ProjectedPoints(place_px, depth, _is_in_image(camera, place_px, np.zeros(1)), near)


def _pinhole_coordinates(camera: OmniCamera, points: Floats) -> Floats:
    """Return (..., 3) places as (x, y, depth): the depth grows from the pinhole to the mirror."""
    return points * (1.0, 1.0, -1.0) + (0.0, 0.0, camera.mirror.pinhole_distance_m)


def _is_in_image(camera: OmniCamera, point_px: Floats, margin_px: Floats) -> Bools:
    """Return which (n, q, 2) places from the image centre lie in the image, or (n, 1) px beside."""
    cos_up, sin_up = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
    x, y = np.moveaxis(point_px, -1, 0)
    u = camera.centre_px[0] + sin_up * x - cos_up * y
    v = camera.centre_px[1] - cos_up * x - sin_up * y
    inside_u = (u >= -margin_px) & (u <= camera.width_px + margin_px)
    inside_v = (v >= -margin_px) & (v <= camera.height_px + margin_px)
    within: Bools = inside_u & inside_v
    return within


def _displacement_px(camera: OmniCamera, point_px: Floats, lookup_direction: Floats) -> Floats:
    """Return the (n, q) distances from places to where (n, q, 3) directions belong."""
    asymptote_rad = 2.0 * math.atan(camera.mirror.t_limit)
    t, _ = half_angle_tangent(lookup_direction)
    t = np.minimum(t, math.tan(0.5 * min(_ASYMPTOTE_FRACTION * asymptote_rad, _MAX_INCIDENCE_RAD)))
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
    rho = np.hypot(lookup_direction[..., 0], lookup_direction[..., 1])
    belongs_px = lookup_direction[..., :2] * (radius_px / np.where(rho > 0.0, rho, 1.0))[..., None]
    distance_px: Floats = np.linalg.norm(belongs_px - point_px, axis=-1)
    return distance_px


def _displacement_rad(camera: OmniCamera, point_px: Floats, lookup_direction: Floats) -> Floats:
    """Return the (n, q) angles between what places show and what the law shows there."""
    ratio = np.hypot(point_px[..., 0], point_px[..., 1]) / camera.horizon_radius_px
    t = camera.mirror.t_from_radius_ratio(ratio)
    level = point_px * (2.0 * t / np.where(ratio > 0.0, ratio, 1.0))[..., None]
    level /= camera.horizon_radius_px
    by_law = np.concatenate((level, ((1.0 - t) * (1.0 + t))[..., None]), axis=-1)
    by_law /= (1.0 + np.square(t))[..., None]
    unit = lookup_direction / np.linalg.norm(lookup_direction, axis=-1, keepdims=True)
    # The chord keeps its precision for small angles, which the cosine does not.
    chord = np.linalg.norm(unit - by_law, axis=-1)
    angle: Floats = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    return angle


def _weighted_rms(values: Floats, weight: Floats) -> float:
    return math.sqrt(float((np.square(values) * weight).sum() / weight.sum()))
