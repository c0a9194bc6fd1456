"""Checks of mirrors without a viewpoint, and parameters of all mirrors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from helpers.lens_checks import assert_is_projection, assert_rejects

# Parameters of a mirror of each kind, for tests of all of them.
_RADII = tuple(0.002 * step for step in range(51))
MIRROR_EXAMPLES: dict[str, tuple[Any, ...]] = {
    "hyperbolic": (11.546, 0.2321),
    "parabolic": (0.03,),
    "spherical": (0.03, 0.2, 2.0),
    "conical": (math.radians(60.0), 0.1, math.radians(100.0)),
    "equiangular": (11.0, 0.1, 2.0),
    "profile": (_RADII, tuple(r * r / 0.08 for r in _RADII), 0.15, 2.0),
    "radial_table": ((0.0, 30.0, 70.0, 110.0), (0.0, 0.05, 0.11, 0.16), 0.1, 1.8),
}


def make_camera(mirror: NonCentralMirror, width_px: int = 640) -> OmniCamera:
    """A camera whose image shows the mirror up to its rim."""
    return camera_with_inscribed_rim(
        mirror, width_px=width_px, height_px=width_px, rim_rad=mirror.rim_rad
    )


def assert_is_mirror(mirror: NonCentralMirror) -> None:
    """Check projection, inverse, surface, viewpoint and miss of a mirror."""
    if mirror.t_min == 0.0:
        assert_is_projection(mirror, to_rad=mirror.rim_rad * (1.0 - 1e-9))
    assert_rejects(mirror, mirror.t_limit * 1.001)
    # A cone's apex has the largest miss of all.
    theta = np.linspace(2.0 * math.atan(mirror.t_min), mirror.rim_rad, 513)
    theta = theta if mirror.t_min > 0.0 else theta[1:]
    t = np.tan(0.5 * theta)
    r, z = mirror.surface_point(t)
    again_t, again_r, again_z = mirror.ray_from_radius_ratio(mirror.radius_ratio_from_t(t))
    for found, expected in ((again_t, t), (again_r, r), (again_z, z)):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-15)
    # The camera ray to the surface point has the image radius, the scene ray the miss.
    np.testing.assert_allclose(
        r / (mirror.pinhole_distance_m - z), mirror.radius_ratio_from_t(t), rtol=1e-12
    )
    miss = np.abs(r * np.cos(theta) - z * np.sin(theta))
    np.testing.assert_allclose(mirror.largest_miss_m(t), miss, rtol=1e-9, atol=1e-15)
    assert_viewpoint_is_best(mirror, theta, r, z)


def assert_viewpoint_is_best(mirror: NonCentralMirror, theta: Floats, r: Floats, z: Floats) -> None:
    """Check that no viewpoint beside the mirror's own has a smaller image error."""
    weight = mirror.radius_ratio_slope(np.tan(0.5 * theta))

    def largest(offset_m: float) -> float:
        miss = np.abs(r * np.cos(theta) - (z - offset_m) * np.sin(theta))
        return float((weight * miss).max())

    step = 1e-3 * float(r.max())
    assert largest(0.0) <= min(largest(step), largest(-step))
