"""Displacement of light in an image: maps of a displaced capture camera, and bounds by motion.

A warp map is the same in every frame. It is bilinear in linear radiance, with neighbours and
weights computed once; outside the image the border pixel is repeated. A pixel whose displacement is
a whole number of pixels is copied bit by bit.

A capture camera may be displaced from the mirror's second focus. A pixel's ray leaves the displaced
pinhole, meets the mirror and is reflected; the pixel of the aligned camera with the same direction
is the one to read. A central mirror is a conic of revolution with a focus in the viewpoint (Baker &
Nayar 1999), which a ray meets at a root of a quadratic. Domain: any central mirror; distant scenes,
since the reflected rays no longer meet in one viewpoint.

Motion displaces light by at most its largest speed, ring by ring. A speed v past the nearest
distance D turns directions by |v| / D, times px per radian; dynamic objects pass at the rates of
the summary; a turn about the optical axis moves a pixel by the angle times the image radius, a turn
about another axis by px per radian. All are added as if they agreed in one pixel, so the sum is a
bound.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import (
    arctan,
    cos,
    hypot,
    interpolate_linear,
    matmul,
    sin,
)
from catoptra_protocol.optics.image_plane import compute_image_scale, pixel_sample_positions
from catoptra_protocol.optics.numerics import (
    Bools,
    Floats,
    half_angle_tangent_from_rho_z,
)
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import NUM_RINGS, EffectBound, Real, SceneSummary
from catoptra_server.effects.kernels.grey_levels import grey_level, max_change_by_shift

_Indices = npt.NDArray[np.intp]
_Float32Array = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class WarpMap:
    """Source pixels and weights of every pixel of a warped image of h x w pixels."""

    corner_indices: tuple[_Indices, _Indices, _Indices, _Indices]
    """(h w,) flat indices of the upper left, upper right, lower left, lower right neighbour."""
    right_weights: _Float32Array
    """(h w, 3) weights of the right neighbours, the same for the three colours."""
    lower_weights: _Float32Array
    """(h w, 3) weights of the lower neighbours, the same for the three colours."""


def warp_map_from_offsets(offsets_px: _Float32Array) -> WarpMap:
    """Warp map of an image whose pixels are sampled (h, w, 2) offsets from their centres, px."""
    height, width = offsets_px.shape[:2]
    whole = np.floor(offsets_px)
    row, column = np.indices((height, width), sparse=True)
    # Clipping the indices repeats the border pixels.
    columns, rows = (
        [np.clip(pixel + whole[..., axis].astype(np.intp) + step, 0, last) for step in (0, 1)]
        for axis, pixel, last in ((0, column, width - 1), (1, row, height - 1))
    )
    right, lower = np.moveaxis((offsets_px - whole).reshape(-1, 2), -1, 0)
    return WarpMap(
        (
            (rows[0] * width + columns[0]).ravel(),
            (rows[0] * width + columns[1]).ravel(),
            (rows[1] * width + columns[0]).ravel(),
            (rows[1] * width + columns[1]).ravel(),
        ),
        # Stored for each colour: a product of equal shapes takes a tenth of the time of a broadcast
        # over an axis of three.
        np.repeat(right[:, None], 3, axis=1),
        np.repeat(lower[:, None], 3, axis=1),
    )


def warp(image: npt.NDArray[Real], warp_map: WarpMap) -> npt.NDArray[Real]:
    """Sample a (h, w, 3) image as a warp map says; the result is a new array."""
    flat = image.reshape(-1, 3)
    # All indices are inside the image already: mode `clip` only spares NumPy's own range check.
    above, right, below, diagonal = (
        flat.take(indices, axis=0, mode="clip") for indices in warp_map.corner_indices
    )
    above += warp_map.right_weights * (right - above)
    below += warp_map.right_weights * (diagonal - below)
    above += warp_map.lower_weights * (below - above)
    return above.reshape(image.shape)


@dataclass(frozen=True, slots=True)
class CameraPoseOffset:
    """Displacement of the capture camera from its aligned pose, in the mirror frame."""

    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Displacement of the pinhole."""
    roll_rad: float = 0.0
    """Turn about x through the pinhole; of an orthographic camera through the viewpoint."""
    pitch_rad: float = 0.0
    """Turn about y through the same point."""


# Offsets are rounded to a nanopixel: the root's rounding would otherwise mix neighbours where a
# pixel is to be copied.
_DECIMALS = 9
# Rows of an image that are looked up together: their arrays stay in the processor's cache, 0.7 of
# the time of 640 x 480 px at once.
_BAND_ROWS = 32


def lookup_offsets_px(
    camera: OmniCamera, pose_offset: CameraPoseOffset
) -> tuple[Floats, Bools, Floats]:
    """Offset from each pixel to the aligned camera's pixel with the same direction.

    Returns:
        (h, w, 2) offsets, px, 0 where nothing is seen; (h, w) validity: False for pixels whose
        centre misses the mirror, or looks beyond the aligned camera's rim; (h, w) fractions of the
        aligned camera's light that the mirror's edge leaves to the pixels.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    offsets_px, valid = np.zeros_like(pixels), np.zeros(pixels.shape[:2], dtype=bool)
    kept = np.zeros(valid.shape)
    # A pixel shows light though its centre lies beyond the rim: the surface is continued.
    wide = _widen_rim(camera)
    for first in range(0, len(pixels), _BAND_ROWS):
        band = slice(first, first + _BAND_ROWS)
        reflected = reflect_rays(wide, pose_offset, pixels[band])
        aligned, in_view = pixel_from_direction(wide, reflected.direction)
        is_met = in_view & reflected.is_hit
        seen_t, edge_t = (
            np.minimum(_half_angle_tangents(one), wide.rim_t)
            for one in (reflected.direction, reflected.point_m)
        )
        valid[band] = is_met & (np.maximum(seen_t, edge_t) <= camera.rim_t)
        # Black beyond the aligned rim is in the image already; an edge within it is not.
        within_rim, within_edge = (
            _covered_fraction(camera.rim_radius_px - wide.radius_px_from_t(t))
            for t in (seen_t, edge_t)
        )
        share = within_edge / np.maximum(within_rim, _LEAST_FRACTION)
        kept[band] = np.where(is_met & (within_rim > 0.0), np.minimum(share, 1.0), 0.0)
        rounded = np.round(aligned - pixels[band], _DECIMALS)
        offsets_px[band] = np.where(kept[band, :, None] > 0.0, rounded, 0.0)
    return offsets_px, valid, kept


_LEAST_FRACTION = 1e-9
# Half a pixel's diagonal, rounded up: farther within an edge a pixel is whole.
_EDGE_REACH_PX = 0.75


def _covered_fraction(within_px: Floats) -> Floats:
    """Fraction of pixels that lies within an edge, by the distances of their centres."""
    fraction: Floats = np.clip(0.5 + 0.5 / _EDGE_REACH_PX * within_px, 0.0, 1.0)
    return fraction


def _half_angle_tangents(vectors: Floats) -> Floats:
    """tan(theta / 2) of (..., 3) vectors; inf opposite to the axis."""
    t, defined = half_angle_tangent_from_rho_z(
        hypot(vectors[..., 0], vectors[..., 1]), vectors[..., 2]
    )
    return np.where(defined, t, np.inf)


def _widen_rim(camera: OmniCamera) -> OmniCamera:
    """The camera with a rim so far out that pixels beyond see nothing of the mirror."""
    t = float(camera.t_from_radius_px(np.array(camera.rim_radius_px + 2.0)))
    limit = camera.projection.t_limit
    widest = min(t, 0.5 * (camera.rim_t + limit))
    return replace(camera, rim_rad=2.0 * float(arctan(widest)))


@dataclass(frozen=True, slots=True, eq=False)
class _ReflectedRays:
    """Rays of the capture camera after their reflection at the mirror, (...) rays."""

    point_m: Floats
    """(..., 3) points of reflection, mirror frame."""
    direction: Floats
    """(..., 3) directions away from the mirror, mirror frame, not of unit length."""
    is_hit: Bools
    """(...) whether the ray meets the mirror within its rim."""


def reflect_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> _ReflectedRays:
    """Reflect the rays of (..., 2) pixels at the mirror."""
    # Vectors lie along the first axis here: three planes with one number per ray, which NumPy
    # works through faster than triples.
    origin, direction = _camera_rays(camera, pose_offset, pixels)
    point, has_met = _meet_mirror(camera, origin, direction)
    away = np.sqrt(_dot(point, point))
    # Half-angle tangent of the direction; the floor keeps the antipode of the axis finite, which
    # no rim reaches.
    t = np.sqrt(point[0] * point[0] + point[1] * point[1])
    t /= np.maximum(away + point[2], 1e-9 * away)
    # The gradient of the surface's equation, of any length.
    normal = _inverse_eccentricity(camera) / away * point
    normal[2] += 1.0
    reflected = direction - 2.0 * _dot(normal, direction) / _dot(normal, normal) * normal
    return _ReflectedRays(
        np.moveaxis(point, 0, -1), np.moveaxis(reflected, 0, -1), has_met & (t <= camera.rim_t)
    )


def _meet_mirror(camera: OmniCamera, origin: Floats, direction: Floats) -> tuple[Floats, Bools]:
    """Points, (3, ...), where rays meet the mirror or its continuation, and whether they do.

    Along a ray from the plane of the vertex, C + 2 B s + A s^2 is the difference of the squares of
    both sides of the conic's equation: see `_inverse_eccentricity`. A ray that does not meet the
    mirror has any finite point.
    """
    inverse, vertex_m = _inverse_eccentricity(camera), _vertex_height_m(camera)
    falls = direction[2] < 0.0
    # From there all numbers are of the mirror's size, however far the pinhole is.
    to_plane = (origin[2] - vertex_m) / np.where(falls, -direction[2], 1.0)
    start = origin + to_plane * direction
    dx, dy, dz = direction
    square = inverse * inverse
    a = square * (dx * dx + dy * dy) - (1.0 - inverse) * (1.0 + inverse) * dz * dz
    b = square * (start[0] * dx + start[1] * dy) + inverse * (1.0 + inverse) * vertex_m * dz
    c = square * (start[0] * start[0] + start[1] * start[1])
    discriminant = b * b - a * c
    root = np.sqrt(np.maximum(discriminant, 0.0))
    # Two forms of the root where the ray enters: the one for the sign of b does not cancel.
    numerator, denominator = np.where(b > 0.0, b + root, c), np.where(b > 0.0, -a, root - b)
    has_root = falls & (discriminant >= 0.0) & (denominator > 0.0)
    beyond = np.where(has_root, numerator, 0.0) / np.where(has_root, denominator, 1.0)
    return start + beyond * direction, has_root & (to_plane + beyond > 0.0)


def _camera_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> tuple[Floats, Floats]:
    """Origins and directions, (3, ...) each, in the mirror frame."""
    # Directions have length 1 along the camera's own axis.
    du, dv = np.moveaxis(pixels - np.asarray(camera.centre_px), -1, 0)
    cosine, sine = cos(camera.image_up_azimuth_rad), sin(camera.image_up_azimuth_rad)
    x, y, zero = sine * du - cosine * dv, -cosine * du - sine * dv, np.zeros_like(du)
    rotation = rotation_from_rpy(pose_offset.roll_rad, pose_offset.pitch_rad, 0.0)
    translation = _column_vector(pose_offset.translation_m, du.ndim)
    if math.isinf(camera.mirror.pinhole_distance_m):
        # Parallel rays: pixels are points of a plane beyond the mirror, two rim radii away.
        rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])
        scale = rim_m / camera.rim_radius_px
        start = np.stack((scale * x, scale * y, zero + 2.0 * rim_m))
        origin = _rotate(rotation, start) + translation
        return origin, _rotate(rotation, np.stack((zero, zero, zero - 1.0)))
    origin = _column_vector((0.0, 0.0, camera.mirror.pinhole_distance_m), du.ndim) + translation
    scale = camera.inverse_focal_length
    return origin, _rotate(rotation, np.stack((scale * x, scale * y, zero - 1.0)))


def _inverse_eccentricity(camera: OmniCamera) -> float:
    """1 / e of a central mirror: a point at the distance rho from the viewpoint and the height z
    has rho / e = (1 + 1 / e) z_vertex - z. A plane has 0, a paraboloid 1.
    """
    return 1.0 - 2.0 * _vertex_height_m(camera) / camera.mirror.pinhole_distance_m


def _vertex_height_m(camera: OmniCamera) -> float:
    return float(camera.mirror.surface_point(np.array(0.0))[1])


def _column_vector(vector: tuple[float, float, float], dimensions: int) -> Floats:
    """Vector of shape (3, 1, ...) that broadcasts against (3, ...) with `dimensions` more axes."""
    return np.asarray(vector).reshape(3, *(1,) * dimensions)


def _rotate(rotation: Floats, vectors: Floats) -> Floats:
    return np.moveaxis(matmul(np.moveaxis(vectors, 0, -1), rotation.T), -1, 0)


def _dot(one: Floats, other: Floats) -> Floats:
    dot: Floats = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return dot


# Fields of a summary that `bound_motion` reads.
MOTION_FIELDS = frozenset(
    {"scene_twist", "min_distances_m", "max_object_rates_rad_s", "max_radiance"}
)


# Below, no renderer moves anything: float32 directions are known to about a thousandth of a pixel.
_MIN_DISPLACEMENT_PX = 2e-3


def bound_motion(
    summary: SceneSummary, camera: RadialCamera, durations_s: Floats | float
) -> EffectBound:
    """Bound the change of an image in which everything moves, with its cause.

    However little is displaced, an edge may pass all samples of a pixel: that of black and the
    brightest counts whole.

    Args:
        summary: Distances and motions.
        camera: Camera of the image.
        durations_s: Duration of the motion, one or (NUM_RINGS,).
    """
    durations_s = np.broadcast_to(durations_s, NUM_RINGS)
    displacements_px = durations_s * _max_speeds_px_s(summary, camera)
    ring = int(displacements_px.argmax())
    displacement_px = float(displacements_px[ring])
    is_still = displacement_px < _MIN_DISPLACEMENT_PX
    light = summary.picture_radiance
    return EffectBound(
        max_change_by_shift(displacement_px, light) if is_still else grey_level(light),
        _describe_motion(summary, ring, float(durations_s[ring])),
        displacement_px,
    )


def _max_speeds_px_s(summary: SceneSummary, camera: RadialCamera) -> Floats:
    """Largest speed in each ring of the image, (NUM_RINGS,), px/s."""
    scale, radius_px = ring_scales_and_radii(camera)
    x, y, z = summary.scene_twist.angular_rad_s
    # An infinite distance gives a rate of 0: a world without anything near needs no special case.
    rates = summary.scene_twist.speed_m_s / np.asarray(summary.min_distances_m)
    rates = rates + np.asarray(summary.max_object_rates_rad_s) + hypot(x, y)
    # The turn about the axis acts by the radius itself: near the image centre that is far less
    # than px per radian.
    speeds: Floats = rates * scale + abs(z) * radius_px
    return speeds


# Scales are known at sampled radii and smooth between them; a pixel centre exceeds them by less.
_INTERPOLATION_MARGIN = 1.001


@lru_cache(maxsize=16)
def ring_scales_and_radii(camera: RadialCamera) -> tuple[Floats, Floats]:
    """Largest px per radian of each ring, and the ring's outer radius in px, (NUM_RINGS,) each."""
    scale = compute_image_scale(camera)
    largest = np.maximum(scale.radial, scale.tangential)
    radius_px = scale.radius_px
    edges_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    # The maximum of a ring may lie on its edge, between two sampled radii: both edges belong to
    # each ring.
    radii = np.concatenate((radius_px, edges_px))
    at_edges = interpolate_linear(edges_px, radius_px, largest)
    values = np.concatenate((largest, at_edges))
    rings = [
        values[(inner <= radii) & (radii <= outer)].max() for inner, outer in pairwise(edges_px)
    ]
    return _INTERPOLATION_MARGIN * np.array(rings), edges_px[1:]


def _describe_motion(summary: SceneSummary, ring: int, duration_s: float) -> str:
    """Describe the motion in a ring and its duration, for the reason of a bound."""
    min_distance_m = summary.min_distances_m[ring]
    parts = []
    if summary.scene_twist.speed_m_s > 0.0 and math.isfinite(min_distance_m):
        parts.append(f"up to {summary.scene_twist.speed_m_s:.2g} m/s at {min_distance_m:.2g} m")
    turn = math.degrees(hypot(*summary.scene_twist.angular_rad_s))
    if turn > 0.0:
        parts.append(f"turns by up to {turn:.3g} degrees/s")
    object_rate_rad_s = summary.max_object_rates_rad_s[ring]
    if object_rate_rad_s > 0.0:
        parts.append(f"objects pass by at {math.degrees(object_rate_rad_s):.2g} degrees/s")
    return ", ".join((*parts, f"{1e3 * duration_s:.3g} ms")) if parts else "nothing moves"
