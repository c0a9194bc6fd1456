from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy
from catoptra_server.world.world_description import AT_REST, Twist

MOVING = Twist((1.0, 2.0, 3.0), (0.1, -0.2, 0.4))


def test_integrated_pose_is_the_limit_of_small_steps() -> None:
    pose, steps = Pose.from_rpy((1, 2, 3), (0.1, 0.2, 0.3)), 2**20
    # The rotation by a vector is the limit of many small ones.
    step = np.eye(3) + np.cross(np.eye(3), np.asarray(MOVING.angular_rad_s) * 0.5 / steps)
    carried = MOVING.integrate_pose(pose, 0.5)
    turned = np.linalg.matrix_power(step, steps) @ pose.rotation
    np.testing.assert_allclose(carried.rotation, turned, atol=1e-5)
    np.testing.assert_allclose(carried.translation, (1.5, 3.0, 4.5))


def test_pose_at_rest_stays_the_same_object() -> None:
    pose = Pose.from_rpy((1, 2, 3))
    assert AT_REST.integrate_pose(pose, 9.0) is pose


def test_twist_at_another_origin_is_of_the_same_rigid_motion() -> None:
    offset, point = np.array((0.3, -0.7, 2.0)), np.array((4.0, 5.0, -1.0))
    velocity = np.asarray(MOVING.linear_m_s) + np.cross(MOVING.angular_rad_s, point)
    there = MOVING.at_offset(offset)
    same = np.asarray(there.linear_m_s) + np.cross(there.angular_rad_s, point - offset)
    np.testing.assert_allclose(same, velocity)


def test_rotated_twist_keeps_its_speed_and_is_at_rest_relative_to_itself() -> None:
    turned = MOVING.rotate(rotation_from_rpy(0.3, 0.2, 0.1))
    assert turned.speed_m_s == pytest.approx(MOVING.speed_m_s)
    assert MOVING.relative_to(MOVING) == AT_REST
