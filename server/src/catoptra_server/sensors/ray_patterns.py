"""What laser and sonar have in common: a fan's angles, a cone's directions, a range's limits."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats

# Files give angles in few digits: 3.14159 / 0.01745 is 180.03 steps, 3.14 / 0.157 exactly 20.
_STEP_COUNT_TOLERANCE = 1e-3


def scan_angles(fov_rad: float, resolution_rad: float) -> Floats:
    """Return (n,) angles from +fov / 2, right or up, to -fov / 2, left or down.

    Both ends are included: 180 degrees in steps of one are 181 beams.
    """
    count = math.floor(fov_rad / resolution_rad + _STEP_COUNT_TOLERANCE) + 1
    return 0.5 * fov_rad - resolution_rad * np.arange(count, dtype=np.float64)


def beam_directions(*, yaw_rad: Floats, pitch_rad: Floats) -> Floats:
    """Return (n, 3) unit directions that are turned from x by pitch, up, and yaw, to the right."""
    level = np.cos(pitch_rad)
    return np.stack((level * np.cos(yaw_rad), level * np.sin(yaw_rad), -np.sin(pitch_rad)), axis=-1)


def cone_directions(angle_rad: float, *, num_rings: int, rays_per_ring: int) -> Floats:
    """Return (1 + rings * rays, 3) unit directions: the x axis, then rings out to half the angle.

    Each ring is turned by half a step against the one inside it.
    """
    if not num_rings:
        return np.array([[1.0, 0.0, 0.0]])
    off_axis = 0.5 * angle_rad * np.repeat(np.arange(1, num_rings + 1), rays_per_ring) / num_rings
    step = np.tile(np.arange(rays_per_ring), num_rings) + 0.5 * (
        np.repeat(np.arange(num_rings), rays_per_ring) % 2
    )
    around = 2.0 * math.pi * step / rays_per_ring
    sine = np.sin(off_axis)
    ring = np.stack((np.cos(off_axis), sine * np.cos(around), sine * np.sin(around)), axis=-1)
    return np.concatenate((((1.0, 0.0, 0.0),), ring))


def clamp_ranges(ranges_m: Floats, *, min_m: float | Floats, max_m: float | Floats) -> Floats:
    """Return what a sensor tells of distances: nothing met reads as its maximum."""
    return np.clip(ranges_m, min_m, max_m)
