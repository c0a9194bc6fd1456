"""Parabolic mirror: Eq. 2 exactly, and a surface that reflects rays along the axis."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror

MIRROR = ParabolicMirror(0.05)
T = np.array([0.0, 1e-300, 0.3, 1.0, 1.7, 100.0])


def test_ratio_is_eq_2_and_its_own_inverse() -> None:
    theta = np.radians([20.0, 60.0, 90.0, 120.0])
    t = np.tan(0.5 * theta)
    np.testing.assert_allclose(
        MIRROR.radius_ratio_from_t(t), np.sin(theta) / (1.0 + np.cos(theta)), rtol=1e-14
    )
    np.testing.assert_array_equal(MIRROR.t_from_radius_ratio(MIRROR.radius_ratio_from_t(t)), t)


def test_ray_when_aimed_at_the_viewpoint_leaves_along_the_axis() -> None:
    r, z = MIRROR.surface_point(T)
    normal = np.stack((r / 0.05, np.ones_like(r)), axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    inward = -np.stack((r, z), axis=-1) / np.hypot(r, z)[:, None]
    reflected = inward - 2.0 * np.einsum("ij,ij->i", inward, normal)[:, None] * normal
    np.testing.assert_allclose(reflected, np.tile([0.0, 1.0], (len(T), 1)), atol=1e-12)


def test_slope_is_the_derivative() -> None:
    theta, step = np.radians([10.0, 90.0, 150.0]), 1e-6
    t = np.tan(0.5 * theta)
    difference = (np.tan(0.5 * (theta + step)) - np.tan(0.5 * (theta - step))) / (2.0 * step)
    np.testing.assert_allclose(MIRROR.radius_ratio_slope(t), difference, rtol=1e-8)


def test_camera_is_orthographic_and_sees_all_but_the_antipode() -> None:
    assert (MIRROR.pinhole_distance_m, MIRROR.t_limit) == (math.inf, math.inf)


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_radius_when_no_mirror_is_rejected(radius: float) -> None:
    with pytest.raises(DomainError, match="radius > 0"):
        ParabolicMirror(radius)
