"""What laser and sonar have in common: directions of a fan and of a cone, and limits of a range."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats

# Files give angles in few digits: 3.14159 / 0.01745 is 180.03 steps, 3.14 / 0.157 exactly 20.
_STEP_TOLERANCE = 1e-3


def fan(fov_rad: float, resolution_rad: float) -> Floats:
    """Return (n, 3) unit directions in the x-y plane from the right (+fov / 2) to the left.

    Both ends are included: 180 degrees in steps of one are 181 beams.
    """
    count = math.floor(fov_rad / resolution_rad + _STEP_TOLERANCE) + 1
    yaw = 0.5 * fov_rad - resolution_rad * np.arange(count)
    return np.stack((np.cos(yaw), np.sin(yaw), np.zeros(count)), axis=-1)


def cone(angle_rad: float, *, rings: int, rays: int) -> Floats:
    """Return (1 + rings * rays, 3) unit directions: the x axis, then rings out to half the angle.

    Each ring is turned by half a step against the one inside it.
    """
    if not rings:
        return np.array([[1.0, 0.0, 0.0]])
    off_axis = 0.5 * angle_rad * np.repeat(np.arange(1, rings + 1), rays) / rings
    step = np.tile(np.arange(rays), rings) + 0.5 * (np.repeat(np.arange(rings), rays) % 2)
    around = 2.0 * math.pi * step / rays
    sine = np.sin(off_axis)
    ring = np.stack((np.cos(off_axis), sine * np.cos(around), sine * np.sin(around)), axis=-1)
    return np.concatenate((((1.0, 0.0, 0.0),), ring))


def limited(ranges_m: Floats, *, min_m: float | Floats, max_m: float | Floats) -> Floats:
    """Return what a sensor tells of distances: nothing met reads as its maximum."""
    return np.clip(ranges_m, min_m, max_m)
