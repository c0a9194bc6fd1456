"""Displacement by a mirror mesh, evaluated on the facets in float64; and the measure of any error.

On a facet all is known in closed form: a point, the pixel in the capture camera, the direction
interpolated there, and the pixel to which the camera model projects that direction. The distance of
the two pixels is the error. A grid of each triangle is evaluated, borders included, and only in
sectors that neither mesh nor cube repeat.

From a grid to a bound: the error vanishes at the corners, and in between is a quadratic form sum
a_ij w_i w_j of the barycentric weights, up to terms that fall with the next power of the facet's
size. The error of linear interpolation between grid points 1/k apart is the same form, k^2 times
smaller. So the largest error is at most the grid's divided by 1 - 1/k^2. Terms that are not
quadratic, such as kinks where a coarse facet looks past the mirror's asymptote, are of first order
in 1/k and smaller by a facet's angle: pi / S of 1/k is added for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import (
    arcsin,
    arctan,
    cos,
    dot,
    hypot,
    interpolate_linear,
    matmul,
    sin,
    tan,
)
from catoptra_protocol.optics.image_plane import shows_whole_rim
from catoptra_protocol.optics.numerics import Bools, Floats, half_angle_tangent
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation, build_mirror_mesh


@dataclass(frozen=True, slots=True)
class GeometricError:
    """Displacement in the image, and as an angle at the effective viewpoint."""

    max_px: float
    """No pixel is displaced farther."""
    rms_px: float
    """Root mean square over the image area."""
    max_deg: float
    """No direction is displaced farther."""
    rms_deg: float
    """Root mean square over the image area."""
    by_radius_px: tuple[float, ...] = ()
    """Largest displacement in each of NUM_RADII rings of equal width, from the centre to the rim;
    empty: alike in all."""

    def at_px(self, radius: float) -> float:
        """Largest displacement in the ring of a radius, over the rim's."""
        rings = self.by_radius_px or (self.max_px,)
        return rings[min(int(radius * len(rings)), len(rings) - 1)]


def sum_errors(errors: Iterable[GeometricError]) -> GeometricError:
    """Sum of errors: maxima add up in each ring, rms values of independent errors in squares."""
    every = tuple(errors)
    rings = [error.by_radius_px or NUM_RADII * (error.max_px,) for error in every]
    by_radius_px = tuple(map(math.fsum, zip(*rings, strict=True)))
    return GeometricError(
        max_px=max(by_radius_px, default=0.0),
        rms_px=hypot(*(error.rms_px for error in every)),
        max_deg=math.fsum(error.max_deg for error in every),
        rms_deg=hypot(*(error.rms_deg for error in every)),
        by_radius_px=by_radius_px,
    )


def apply_floor(error: GeometricError, floor: GeometricError) -> GeometricError:
    """Error with maxima no smaller than another's; the rms stays."""
    return replace(
        error,
        max_px=max(error.max_px, floor.max_px),
        max_deg=max(error.max_deg, floor.max_deg),
    )


def weighted_rms(values: Floats, weight: Floats) -> float:
    """Root mean square over image areas."""
    return math.sqrt(float((np.square(values) * weight).sum() / weight.sum()))


NUM_RADII = 64
"""Rings of the bound by place: a picture of 640 px has rings of 5 px."""


def max_by_radius(camera: OmniCamera, radius_px: Floats, values: Floats) -> tuple[float, ...]:
    """Largest of (n,) values in each ring, between rising (n,) image radii linear."""
    ring = radius_px / camera.rim_radius_px * NUM_RADII
    borders = interpolate_linear(np.arange(NUM_RADII + 1.0), ring, values)
    largest = np.maximum(borders[:-1], borders[1:])
    np.maximum.at(largest, np.clip(ring.astype(int), 0, NUM_RADII - 1), values)
    return tuple(largest.tolist())


_SAME_RADIUS = 1e-9
# Finest first; even, as the quadrature needs. Two steps overstate the error by a third: 1 / (1 -
# 1/4).
_STEP_COUNTS = (32, 16, 8, 6, 4, 2)
# Number of points evaluated at most: 20 ms, and 64 x 64 polygons still have 8 steps.
_MAX_GRID_POINTS = 120_000
# A facet may show directions beyond the rim. Their pixels follow from the camera model up to near
# the asymptote; beyond, no pixel exists and the last one stands for all.
_ASYMPTOTE_FRACTION = 0.999
_MAX_INCIDENCE_RAD = math.radians(178.0)


def rim_gap(camera: OmniCamera, tessellation: Tessellation) -> GeometricError:
    """Distance by which the mesh ends within the rim, largest at the centres of the outer edges."""
    radius_px = camera.rim_radius_px
    chord_px = radius_px * cos(math.pi / tessellation.sectors)
    # 1 - cos as 2 sin^2 of the half: no cancellation for many sectors.
    gap_px = 2.0 * radius_px * float(np.square(sin(0.5 * math.pi / tessellation.sectors)))
    t = camera.projection.t_from_radius_ratio(np.array(chord_px / camera.scale_px))
    gap_deg = math.degrees(camera.rim_rad - 2.0 * arctan(float(t)))
    return GeometricError(gap_px, 0.0, gap_deg, 0.0)


@lru_cache(maxsize=256)
def facet_errors(camera: OmniCamera, tessellation: Tessellation) -> GeometricError:
    """Displacement over the pixels that the mesh covers.

    Raises:
        DomainError: An orthographic camera; a mesh is projected from a pinhole.
    """
    if not math.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("a mirror mesh needs a capture camera with a pinhole")
    corners, directions = _distinct_triangles(camera, tessellation)
    steps = _grid_steps(len(corners))
    weights, quadrature = _triangle_grid(steps)
    projected = _project_points(camera, matmul(weights, corners), steps)
    lookup_direction = matmul(weights, directions)
    # Weights are image areas: the projection of a flat triangle has the density det / depth^3.
    first, second, third = np.moveaxis(_pinhole_coordinates(camera, corners), 1, 0)
    volume, depth_m = np.abs(dot(np.cross(first, second), third))[:, None], projected.depth_m
    area = volume / (depth_m * depth_m * depth_m)
    area = area * quadrature * projected.is_in_image
    error_px = _displacement_px(camera, projected.point_px, lookup_direction)
    error_rad = _displacement_rad(camera, projected.point_px, lookup_direction)
    reserve = (1.0 + math.pi / tessellation.sectors / steps) / (1.0 - 1.0 / steps**2)
    return GeometricError(
        max_px=reserve * float(error_px[projected.is_near_image].max()),
        rms_px=weighted_rms(error_px, area),
        max_deg=reserve * math.degrees(float(error_rad[projected.is_near_image].max())),
        rms_deg=math.degrees(weighted_rms(error_rad, area)),
        by_radius_px=_max_in_rings(camera, projected, reserve * error_px),
    )


def _max_in_rings(
    camera: OmniCamera, projected: _ProjectedPoints, error_px: Floats
) -> tuple[float, ...]:
    """Largest of (n, q) errors in each ring that a triangle reaches into."""
    # By whole triangles: between grid points an error belongs to all of a triangle.
    radius = np.linalg.norm(projected.point_px, axis=-1) / camera.rim_radius_px * NUM_RADII
    largest = np.where(projected.is_near_image, error_px, 0.0).max(axis=1)
    # Corners on the border of two rings belong to both.
    first = np.clip(np.floor(radius.min(axis=1) - _SAME_RADIUS).astype(int), 0, NUM_RADII - 1)
    last = np.clip(np.floor(radius.max(axis=1) + _SAME_RADIUS).astype(int), 0, NUM_RADII - 1)
    return tuple(
        float(largest[(first <= ring) & (ring <= last)].max(initial=0.0))
        for ring in range(NUM_RADII)
    )


def _distinct_triangles(camera: OmniCamera, tessellation: Tessellation) -> tuple[Floats, Floats]:
    """(n, 3, 3) corners and looked-up directions of the sectors that no symmetry repeats."""
    mesh = build_mirror_mesh(camera, tessellation)
    polygon = np.concatenate(
        (
            np.arange(tessellation.num_polygons),
            np.arange(tessellation.sectors, tessellation.num_polygons),
        )
    )
    is_distinct = polygon % tessellation.sectors < _num_distinct_sectors(camera, tessellation)
    return mesh.corners[is_distinct], mesh.directions[is_distinct]


def _num_distinct_sectors(camera: OmniCamera, tessellation: Tessellation) -> int:
    """Number of sectors after which the error repeats.

    By any rotation for position interpolation, by quarter turns of the cube for UV.
    """
    if not shows_whole_rim(camera):
        return tessellation.sectors
    if tessellation.interpolation is Interpolation.POSITION:
        return 1
    # UV coordinates belong to cube faces, so the pattern has the cube's fourfold symmetry.
    return tessellation.sectors // math.gcd(tessellation.sectors, 4)


def _grid_steps(num_triangles: int) -> int:
    """Finest affordable number of steps along a triangle's side."""
    fitting = (
        k for k in _STEP_COUNTS if num_triangles * (k + 1) * (k + 2) // 2 <= _MAX_GRID_POINTS
    )
    return next(fitting, _STEP_COUNTS[-1])


@lru_cache(maxsize=len(_STEP_COUNTS))
def _triangle_grid(steps: int) -> tuple[Floats, Floats]:
    """(q, 3) barycentric weights of a grid with borders, and the (q,) quadrature.

    The quadrature is the rule of the three side midpoints, exact for quadratics, on triangles of
    two steps: points with two even indices weigh nothing, those on a border half.
    """
    i, j = np.nonzero(np.add.outer(np.arange(steps + 1), np.arange(steps + 1)) <= steps)
    weights = np.stack((i, j, steps - i - j), axis=-1)
    is_midpoint = (weights % 2 != 0).any(axis=-1)
    quadrature = is_midpoint * np.where((weights == 0).any(axis=-1), 0.5, 1.0)
    return weights / steps, quadrature


@dataclass(frozen=True, slots=True, eq=False)
class _ProjectedPoints:
    """Points on facets as the capture camera sees them; n triangles with q points each."""

    point_px: Floats
    """(n, q, 2) from the image centre, along the mirror frame's x and y."""
    depth_m: Floats
    """(n, q) from the pinhole along the axis."""
    is_in_image: Bools
    """(n, q)."""
    is_near_image: Bools
    """(n, q) in the image, or no farther away than a grid step."""


def _project_points(camera: OmniCamera, points: Floats, steps: int) -> _ProjectedPoints:
    """Project (n, q, 3) points, q of a grid of some steps, into the image."""
    x, y, depth = np.moveaxis(_pinhole_coordinates(camera, points), -1, 0)
    rim_r, rim_z = camera.mirror.surface_point(np.array(camera.rim_t))
    focal_px = (
        camera.rim_radius_px * (camera.mirror.pinhole_distance_m - float(rim_z)) / float(rim_r)
    )
    point_px = np.stack((x, y), axis=-1) * (focal_px / depth)[..., None]
    if shows_whole_rim(camera):
        everywhere = np.ones(depth.shape, dtype=np.bool_)
        return _ProjectedPoints(point_px, depth, everywhere, everywhere)
    extent_px = np.ptp(point_px, axis=1).max(axis=-1, keepdims=True)
    # The diagonal of a grid step: no pixel of the image is farther from a grid point.
    margin_px = math.sqrt(2.0) * extent_px / steps
    is_near = _is_in_image(camera, point_px, margin_px)
    is_inside = _is_in_image(camera, point_px, np.zeros(1))
    return _ProjectedPoints(point_px, depth, is_inside, is_near)


def _pinhole_coordinates(camera: OmniCamera, points: Floats) -> Floats:
    """(..., 3) points as (x, y, depth); depth grows from the pinhole to the mirror."""
    return points * (1.0, 1.0, -1.0) + (0.0, 0.0, camera.mirror.pinhole_distance_m)


def _is_in_image(camera: OmniCamera, point_px: Floats, margin_px: Floats) -> Bools:
    """Whether (n, q, 2) points from the image centre lie in the image or within (n, 1) px of its
    border."""
    cos_up, sin_up = cos(camera.image_up_azimuth_rad), sin(camera.image_up_azimuth_rad)
    x, y = np.moveaxis(point_px, -1, 0)
    u = camera.centre_px[0] + sin_up * x - cos_up * y
    v = camera.centre_px[1] - cos_up * x - sin_up * y
    inside_u = (u >= -margin_px) & (u <= camera.width_px + margin_px)
    inside_v = (v >= -margin_px) & (v <= camera.height_px + margin_px)
    inside: Bools = inside_u & inside_v
    return inside


def _displacement_px(camera: OmniCamera, point_px: Floats, lookup_direction: Floats) -> Floats:
    """(n, q) distances from pixels to the pixels of their (n, q, 3) looked-up directions."""
    asymptote_rad = 2.0 * arctan(camera.projection.t_limit)
    t, _ = half_angle_tangent(lookup_direction)
    t = np.minimum(t, tan(0.5 * min(_ASYMPTOTE_FRACTION * asymptote_rad, _MAX_INCIDENCE_RAD)))
    radius_px = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    rho = hypot(lookup_direction[..., 0], lookup_direction[..., 1])
    model_px = lookup_direction[..., :2] * (radius_px / np.where(rho > 0.0, rho, 1.0))[..., None]
    distance_px: Floats = np.linalg.norm(model_px - point_px, axis=-1)
    return distance_px


def _displacement_rad(camera: OmniCamera, point_px: Floats, lookup_direction: Floats) -> Floats:
    """(n, q) angles between the looked-up directions and the camera model's."""
    ratio = hypot(point_px[..., 0], point_px[..., 1]) / camera.scale_px
    t = camera.projection.t_from_radius_ratio(ratio)
    level = point_px * (2.0 * t / np.where(ratio > 0.0, ratio, 1.0))[..., None]
    level /= camera.scale_px
    model_direction = np.concatenate((level, ((1.0 - t) * (1.0 + t))[..., None]), axis=-1)
    model_direction /= (1.0 + np.square(t))[..., None]
    unit = lookup_direction / np.linalg.norm(lookup_direction, axis=-1, keepdims=True)
    # The chord keeps precision for small angles, unlike the cosine.
    chord = np.linalg.norm(unit - model_direction, axis=-1)
    angle: Floats = 2.0 * arcsin(np.minimum(0.5 * chord, 1.0))
    return angle
