"""Mounts and poses on the floor."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.simulation.robot_description import Mount, PlanarPose


def test_mount_by_default_is_the_chassis() -> None:
    assert Mount().parent == "HARD"


def test_transform_of_a_turned_mount_faces_sideways() -> None:
    pose = Mount((0.1, 0.2, 0.3), (0.0, 0.0, math.pi / 2)).parent_from_item()
    np.testing.assert_allclose(pose.transform_points(np.array([1.0, 0.0, 0.0])), (0.1, 1.2, 0.3))


def test_pose_when_at_a_height_is_above_the_floor_and_turned() -> None:
    pose = PlanarPose(1.0, 2.0, 0.5).at_height(0.3)
    np.testing.assert_array_equal(pose.translation, (1.0, 2.0, -0.3))
    assert pose.to_rpy() == pytest.approx((0.0, 0.0, 0.5))


def test_pose_turned_clockwise_faces_right() -> None:
    ahead = (
        PlanarPose(0.0, 0.0, 0.5 * np.pi)
        .at_height(0.0)
        .rotate_directions(np.array([1.0, 0.0, 0.0]))
    )
    np.testing.assert_allclose(ahead, (0.0, 1.0, 0.0), atol=1e-15)
