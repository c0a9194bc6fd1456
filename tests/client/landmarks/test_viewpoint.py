"""Viewpoint on the robot: poses and polar coordinates."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.landmarks.blobs import (
    Viewpoint,
    robot_from_viewpoint_polar,
    world_from_mirror,
)
from catoptra_protocol.errors import DomainError


def test_viewpoint_stands_above_the_robot_turned_with_it() -> None:
    pose = world_from_mirror(Viewpoint(0.6, forward_m=0.2), np.array([1.0, 2.0, math.pi / 2]))
    np.testing.assert_allclose(pose.translation, [1.0, 2.2, -0.6], atol=1e-15)
    np.testing.assert_allclose(pose.rotate_directions(np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-15)


def test_polar_without_an_offset_is_unchanged() -> None:
    range_m, bearing, jacobian = robot_from_viewpoint_polar(Viewpoint(), np.array([2.0, 0.5]))
    assert (range_m, bearing) == (2.0, 0.5)
    np.testing.assert_array_equal(jacobian, np.eye(2))


def test_polar_with_an_offset_adds_the_vectors() -> None:
    viewpoint = Viewpoint(0.6, forward_m=-1.0, right_m=1.0)
    range_m, bearing, _ = robot_from_viewpoint_polar(viewpoint, np.array([1.0, 0.0]))
    assert (range_m, bearing) == pytest.approx((1.0, math.pi / 2))


def test_jacobian_of_an_offset_equals_differences() -> None:
    viewpoint, polar, step = Viewpoint(0.6, forward_m=0.3, right_m=-0.2), np.array([1.7, 2.5]), 1e-6
    ours = robot_from_viewpoint_polar(viewpoint, polar)[2]
    for column in range(2):
        off = np.eye(2)[column] * step
        ahead = robot_from_viewpoint_polar(viewpoint, polar + off)[:2]
        behind = robot_from_viewpoint_polar(viewpoint, polar - off)[:2]
        differences = np.subtract(ahead, behind) / (2 * step)
        np.testing.assert_allclose(ours[:, column], differences, rtol=0, atol=1e-9)


@pytest.mark.parametrize("height", [0.0, -0.6, math.nan, math.inf])
def test_viewpoint_in_the_floor_is_rejected(height: float) -> None:
    with pytest.raises(DomainError, match="above the floor"):
        Viewpoint(height)


def test_point_at_the_robots_origin_has_no_bearing() -> None:
    with pytest.raises(DomainError, match="no bearing"):
        robot_from_viewpoint_polar(Viewpoint(0.6, 0.5), np.array([0.5, math.pi]))
