"""Smallest cones around directions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.labels.spherical_box import enclose_directions


def cap(half_angle_rad: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A random axis, and directions within an angle of it, a third of them at the border."""
    random = np.random.default_rng(seed)
    axis = random.standard_normal(3)
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, random.standard_normal(3))
    across /= np.linalg.norm(across)
    other = np.cross(axis, across)
    angle = half_angle_rad * np.where(random.random(count) < 0.33, 1.0, random.random(count))
    turn = random.uniform(0.0, 2.0 * math.pi, count)
    side = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * other
    return axis, np.cos(angle)[:, None] * axis + np.sin(angle)[:, None] * side


@pytest.mark.parametrize("half_angle_deg", [0.01, 1.0, 20.0, 60.0, 85.0])
@pytest.mark.parametrize("seed", range(5))
def test_cone_of_less_than_a_half_space_is_the_smallest(half_angle_deg: float, seed: int) -> None:
    half_angle = math.radians(half_angle_deg)
    axis, directions = cap(half_angle, 400, seed)
    cone = enclose_directions(directions)
    assert cone.contains(directions, 1e-9)
    # A hundred directions at the border, so that no smaller cone is much smaller.
    assert 0.98 * half_angle < cone.half_angle_rad <= half_angle * (1.0 + 1e-6)
    assert math.acos(min(1.0, float(cone.axis @ axis))) < 0.2 * half_angle


@pytest.mark.parametrize("half_angle_deg", [100.0, 140.0, 165.0])
def test_cone_of_more_than_a_half_space_holds_all(half_angle_deg: float) -> None:
    half_angle = math.radians(half_angle_deg)
    _, directions = cap(half_angle, 3000, 4)
    cone = enclose_directions(directions)
    assert cone.contains(directions, 1e-9)
    assert cone.half_angle_rad < half_angle + 0.02


def test_cones_of_one_and_of_two_directions() -> None:
    one = np.array(((0.0, 0.6, 0.8),))
    cone = enclose_directions(one)
    assert cone.half_angle_rad < 1e-7
    two = enclose_directions(np.array(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))))
    np.testing.assert_allclose(two.axis, (math.sqrt(0.5), math.sqrt(0.5), 0.0), atol=1e-12)
    assert two.half_angle_rad == pytest.approx(0.25 * math.pi)


def test_opposite_directions_have_a_cone() -> None:
    both = np.array(((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)))
    cone = enclose_directions(both)
    assert cone.contains(both, 1e-9)
    assert cone.half_angle_rad < 0.5 * math.pi + 0.05
