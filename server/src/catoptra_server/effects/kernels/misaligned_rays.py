"""What a capture camera sees that does not stand at the mirror's focus, far away.

A pixel's ray leaves the displaced pinhole, meets the mirror, is reflected; the pixel of the ideal
camera that shows the same direction is where the picture is to be read. The normal of a central
mirror needs no derivative: it halves the angle between the directions to the scene, away from the
viewpoint, and to the focus where the pinhole belongs. Domain: any central mirror.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    pixel_from_direction,
    pixel_sample_positions,
)
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_server.effects.medium.vignetting import inverse_focal_length

# Newton's method squares the error; it ends where a nanopixel is left. So many steps are enough for
# offsets of a tenth of the mirror; what has not converged by then is not seen.
_MAX_NEWTON_STEPS = 12
_CONVERGENCE_TOLERANCE = 1e-12
# What the search leaves of nothing would mix neighbours where a pixel is to be copied.
_DECIMALS = 9


@dataclass(frozen=True, slots=True)
class CameraPoseOffset:
    """Where the capture camera stands, beside where it belongs, in the mirror frame.

    offset_m: of the pinhole. roll_rad, pitch_rad: turns of the camera about x and y through the
    pinhole; of an orthographic camera, whose pinhole is nowhere, through the effective viewpoint.
    """

    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roll_rad: float = 0.0
    pitch_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class ReflectedRays:
    """What becomes of (...) rays of the capture camera at the mirror.

    place_m, direction: (..., 3) in the mirror frame. met: (...) which meet it within its rim.
    """

    point_m: Floats
    direction: Floats
    is_hit: Bools


def lookup_offsets_px(camera: OmniCamera, pose_offset: CameraPoseOffset) -> tuple[Floats, Bools]:
    """Return (h, w, 2) how far aside of each pixel the ideal picture shows it, and which it does.

    Not shown is what misses the mirror, and what it reflects from beyond the ideal camera's rim.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    reflected = reflect_rays(camera, pose_offset, pixels)
    ideal, shown = pixel_from_direction(camera, reflected.direction)
    seen = shown & reflected.is_hit
    return np.where(seen[..., None], np.round(ideal - pixels, _DECIMALS), 0.0), seen


def reflect_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> ReflectedRays:
    """Return the rays of (..., 2) pixels behind the mirror."""
    # Vectors lie along the first axis in here: three planes of as many numbers as there are rays.
    origin, direction = _camera_rays(camera, pose_offset, pixels)
    distance = (origin[2] - _initial_mirror_height_m(camera, pixels)) / -direction[2]
    # What misses the mirror may go nowhere, but not to infinity.
    least, most = 0.5 * distance, 2.0 * distance
    for _ in range(_MAX_NEWTON_STEPS):
        place = origin + distance * direction
        above, normal, t = _height_above_mirror(camera, place)
        met = t <= camera.rim_t
        if not (np.abs(above) > _CONVERGENCE_TOLERANCE * distance)[met].any():
            break
        steepness = _dot(normal, direction) / _dot(normal, _unit_vectors(place))
        distance = np.clip(distance - above / steepness, least, most)
    met &= np.abs(above) <= _CONVERGENCE_TOLERANCE * distance
    reflected = direction - 2.0 * _dot(normal, direction) * normal
    return ReflectedRays(np.moveaxis(place, 0, -1), np.moveaxis(reflected, 0, -1), met)


def _camera_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> tuple[Floats, Floats]:
    """Return (3, ...) origins and directions, these 1 long along the camera's own axis."""
    du, dv = np.moveaxis(pixels - np.asarray(camera.centre_px), -1, 0)
    ca, sa = math.cos(camera.image_up_azimuth_rad), math.sin(camera.image_up_azimuth_rad)
    x, y, flat = sa * du - ca * dv, -ca * du - sa * dv, np.zeros_like(du)
    turn = rotation_from_rpy(pose_offset.roll_rad, pose_offset.pitch_rad, 0.0)
    offset = _column_vector(pose_offset.translation_m, du.ndim)
    if math.isinf(camera.mirror.pinhole_distance_m):
        rim_m = float(camera.mirror.surface_point(np.array(camera.rim_t))[0])
        scale = rim_m / camera.rim_radius_px
        origin = _rotate(turn, np.stack((scale * x, scale * y, flat + 2.0 * rim_m))) + offset
        return origin, _rotate(turn, np.stack((flat, flat, flat - 1.0)))
    origin = _column_vector((0.0, 0.0, camera.mirror.pinhole_distance_m), du.ndim) + offset
    scale = inverse_focal_length(camera)
    return origin, _rotate(turn, np.stack((scale * x, scale * y, flat - 1.0)))


def _initial_mirror_height_m(camera: OmniCamera, pixels: Floats) -> Floats:
    """Return the height of the mirror that the pixels would see: where the search begins."""
    radius_px = np.hypot(*np.moveaxis(pixels - np.asarray(camera.centre_px), -1, 0))
    within = np.minimum(radius_px, camera.rim_radius_px) / camera.horizon_radius_px
    return camera.mirror.surface_point(camera.mirror.t_from_radius_ratio(within))[1]


def _height_above_mirror(camera: OmniCamera, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return how far (3, ...) places are above the mirror, as the viewpoint sees it; its normal
    there; and t. Beyond its rim the mirror goes on for a little.
    """
    away = np.sqrt(_dot(points, points))
    # Half-angle tangent: the rim of a mirror is far enough from its antipode.
    t = np.hypot(points[0], points[1]) / np.maximum(away + points[2], 1e-9 * away)
    limit = min(2.0 * camera.rim_t, 0.5 * (camera.rim_t + camera.mirror.t_limit))
    r, z = camera.mirror.surface_point(np.minimum(t, limit))
    radius = np.hypot(r, z)
    outward = points / away
    to_focus = _column_vector((0.0, 0.0, 1.0), outward.ndim - 1)
    if math.isfinite(camera.mirror.pinhole_distance_m):
        to_focus = _unit_vectors(camera.mirror.pinhole_distance_m * to_focus - radius * outward)
    return away - radius, _unit_vectors(outward + to_focus), t


def _column_vector(vector: tuple[float, float, float], dimensions: int) -> Floats:
    """Return a (3, 1, ...) vector that goes with as many dimensions."""
    return np.asarray(vector).reshape(3, *(1,) * dimensions)


def _rotate(rotation: Floats, vectors: Floats) -> Floats:
    turned: Floats = np.tensordot(rotation, vectors, axes=1)
    return turned


def _unit_vectors(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.sqrt(_dot(vectors, vectors))
    return unit


def _dot(one: Floats, other: Floats) -> Floats:
    dot: Floats = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    return dot
