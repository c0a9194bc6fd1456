"""Directions seen by a capture camera that is displaced from the mirror's second focus.

A pixel's ray leaves the displaced pinhole, meets the mirror and is reflected; the pixel of the
aligned camera with the same direction is the one to read. The normal of a central mirror needs no
derivative: the normal bisects the angle between the outward direction from the viewpoint and the
direction to the second focus. Domain: any central mirror; distant scenes, since the reflected rays
no longer meet in one viewpoint.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_protocol.slotted_dataclass import dataclass

# Newton's method squares the error in each step; for offsets of a tenth of the mirror twelve steps
# are enough. Rays that have not converged by then count as missing the mirror.
_MAX_NEWTON_STEPS = 12
_CONVERGENCE_TOLERANCE = 1e-12
# Offsets are rounded to a nanopixel: the search's residue would otherwise mix neighbours where a
# pixel is to be copied.
_DECIMALS = 9


@dataclass(frozen=True, slots=True)
class CameraPoseOffset:
    """Displacement of the capture camera from its aligned pose, in the mirror frame."""

    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Displacement of the pinhole."""
    roll_rad: float = 0.0
    """Turn about x through the pinhole; of an orthographic camera through the viewpoint."""
    pitch_rad: float = 0.0
    """Turn about y through the same point."""


@dataclass(frozen=True, slots=True, eq=False)
class ReflectedRays:
    """Rays of the capture camera after their reflection at the mirror, (...) rays."""

    point_m: Floats
    """(..., 3) points of reflection, mirror frame."""
    direction: Floats
    """(..., 3) directions away from the mirror, mirror frame, not of unit length."""
    is_hit: Bools
    """(...) whether the ray meets the mirror within its rim."""


def lookup_offsets_px(camera: OmniCamera, pose_offset: CameraPoseOffset) -> tuple[Floats, Bools]:
    """Offset from each pixel to the aligned camera's pixel with the same direction.

    Returns:
        (h, w, 2) offsets, px, 0 where invalid; (h, w) validity: False for pixels that miss the
        mirror, or whose direction lies beyond the aligned camera's rim.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    reflected = reflect_rays(camera, pose_offset, pixels)
    aligned, in_view = pixel_from_direction(camera, reflected.direction)
    valid = in_view & reflected.is_hit
    return np.where(valid[..., None], np.round(aligned - pixels, _DECIMALS), 0.0), valid


def reflect_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> ReflectedRays:
    """Reflect the rays of (..., 2) pixels at the mirror."""
    # Vectors lie along the first axis here: three planes with one number per ray, which NumPy
    # works through faster than triples.
    origin, direction = _camera_rays(camera, pose_offset, pixels)
    distance = (origin[2] - _initial_mirror_height_m(camera, pixels)) / -direction[2]
    # Rays that miss the mirror have no root: the bounds keep them finite until they are dropped.
    lower, upper = 0.5 * distance, 2.0 * distance
    for _ in range(_MAX_NEWTON_STEPS):
        point = origin + distance * direction
        above, normal, t = _height_above_mirror(camera, point)
        is_hit = t <= camera.rim_t
        if not (np.abs(above) > _CONVERGENCE_TOLERANCE * distance)[is_hit].any():
            break
        # Heights are measured along the ray from the viewpoint: its angle with the normal turns
        # the slope along the capture ray into that of `above`.
        slope = _dot(normal, direction) / _dot(normal, _unit_vectors(point))
        distance = np.clip(distance - above / slope, lower, upper)
    is_hit &= np.abs(above) <= _CONVERGENCE_TOLERANCE * distance
    reflected = direction - 2.0 * _dot(normal, direction) * normal
    return ReflectedRays(np.moveaxis(point, 0, -1), np.moveaxis(reflected, 0, -1), is_hit)


def _camera_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> tuple[Floats, Floats]:
    """Origins and directions, (3, ...) each, in the mirror frame."""
    # Directions have length 1 along the camera's own axis.
    du, dv = np.moveaxis(pixels - np.asarray(camera.centre_px), -1, 0)
    cosine, sine = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
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


def _initial_mirror_height_m(camera: OmniCamera, pixels: Floats) -> Floats:
    """Height of the mirror at the aligned camera's pixels: the start of Newton's method."""
    radius_px = np.hypot(*np.moveaxis(pixels - np.asarray(camera.centre_px), -1, 0))
    within = np.minimum(radius_px, camera.rim_radius_px) / camera.scale_px
    return camera.mirror.surface_point(camera.projection.t_from_radius_ratio(within))[1]


def _height_above_mirror(camera: OmniCamera, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Height of (3, ...) points above the mirror.

    Returns:
        Height along the ray from the viewpoint, m; the surface normal there, (3, ...); t of the
        direction. Beyond the rim the mirror continues for a little.
    """
    away = np.sqrt(_dot(points, points))
    # Half-angle tangent of the direction; the floor keeps the antipode of the axis finite, which
    # no rim reaches.
    t = np.hypot(points[0], points[1]) / np.maximum(away + points[2], 1e-9 * away)
    limit = min(2.0 * camera.rim_t, 0.5 * (camera.rim_t + camera.projection.t_limit))
    r, z = camera.mirror.surface_point(np.minimum(t, limit))
    radius = np.hypot(r, z)
    outward = points / away
    to_focus = _column_vector((0.0, 0.0, 1.0), outward.ndim - 1)
    if math.isfinite(camera.mirror.pinhole_distance_m):
        to_focus = _unit_vectors(camera.mirror.pinhole_distance_m * to_focus - radius * outward)
    return away - radius, _unit_vectors(outward + to_focus), t


def _column_vector(vector: tuple[float, float, float], dimensions: int) -> Floats:
    """Vector of shape (3, 1, ...) that broadcasts against (3, ...) with `dimensions` more axes."""
    return np.asarray(vector).reshape(3, *(1,) * dimensions)


def _rotate(rotation: Floats, vectors: Floats) -> Floats:
    rotated: Floats = np.tensordot(rotation, vectors, axes=1)
    return rotated


def _unit_vectors(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.sqrt(_dot(vectors, vectors))
    return unit


def _dot(one: Floats, other: Floats) -> Floats:
    dot: Floats = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return dot
