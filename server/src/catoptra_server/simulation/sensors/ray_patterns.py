"""Ray directions of laser scanners and sonars, and the limits of ranges."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats

# Files round angles to few digits: 3.14159 / 0.01745 is 180.03 steps, 3.14 / 0.157 exactly 20.
_STEP_COUNT_TOLERANCE = 1e-3


def scan_angles(fov_rad: float, resolution_rad: float) -> Floats:
    """Angles (n,) of a scan from +fov / 2, right or up, to -fov / 2, left or down.

    Both ends are included: 180 degrees in steps of one are 181 beams.
    """
    count = math.floor(fov_rad / resolution_rad + _STEP_COUNT_TOLERANCE) + 1
    # A product for each angle: repeated differences would accumulate rounding.
    return 0.5 * fov_rad - resolution_rad * np.arange(count, dtype=np.float64)


def beam_directions(*, yaw_rad: Floats, pitch_rad: Floats) -> Floats:
    """Unit directions (n, 3), turned from the x axis upwards by pitch and to the right by yaw."""
    level = np.cos(pitch_rad)
    return np.stack((level * np.cos(yaw_rad), level * np.sin(yaw_rad), -np.sin(pitch_rad)), axis=-1)


def cone_directions(angle_rad: float, *, num_rings: int, rays_per_ring: int) -> Floats:
    """Unit directions (1 + num_rings * rays_per_ring, 3) that sample a cone around the x axis.

    The axis comes first, then the rings from the inside out to half the angle.
    """
    if not num_rings:
        return np.array([[1.0, 0.0, 0.0]])
    ring = np.repeat(np.arange(num_rings), rays_per_ring)
    off_axis = 0.5 * angle_rad * (ring + 1) / num_rings
    # Every other ring is turned by half a step: rays fill the gaps of the ring inside.
    step = np.tile(np.arange(rays_per_ring), num_rings) + 0.5 * (ring % 2)
    around = 2.0 * math.pi * step / rays_per_ring
    sine = np.sin(off_axis)
    rays = np.stack((np.cos(off_axis), sine * np.cos(around), sine * np.sin(around)), axis=-1)
    return np.concatenate((((1.0, 0.0, 0.0),), rays))


def clamp_ranges(ranges_m: Floats, *, min_m: float | Floats, max_m: float | Floats) -> Floats:
    """Ranges as a sensor reports distances: inf, without any surface, as the maximum."""
    return np.clip(ranges_m, min_m, max_m)
