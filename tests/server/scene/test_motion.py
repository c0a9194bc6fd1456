from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose, rotation_from_rpy
from catoptra_server.scene.motion import AT_REST, Twist

MOVING = Twist((1.0, 2.0, 3.0), (0.1, -0.2, 0.4))


def test_motion_between_poses_when_repeated_leads_from_the_one_to_the_other() -> None:
    before, after = Pose.from_rpy((1, 2, 3), (0.1, 0.2, 0.3)), Pose.from_rpy((2, 0, 3), (0.4, 0, 1))
    twist = Twist.between(before, after, 0.5)
    np.testing.assert_allclose(twist.linear_m_s, (2.0, -4.0, 0.0))
    # The rotation by a vector is the limit of many small ones.
    step = np.eye(3) + np.cross(np.eye(3), np.asarray(twist.angular_rad_s) * 0.5 / 2**20)
    turned = np.linalg.matrix_power(step, 2**20) @ before.rotation
    np.testing.assert_allclose(turned, after.rotation, atol=1e-5)


def test_motion_between_equal_poses_is_rest() -> None:
    assert Twist.between(Pose.identity(), Pose.identity(), 0.02) == AT_REST


def test_motion_when_the_turn_is_tiny_keeps_its_digits() -> None:
    after = Pose.from_rpy((0, 0, 0), (0, 0, 1e-12))
    assert Twist.between(Pose.identity(), after, 1.0).angular_rad_s[2] == pytest.approx(1e-12)


def test_motion_when_told_elsewhere_is_that_of_the_same_rigid_body() -> None:
    offset, point = np.array((0.3, -0.7, 2.0)), np.array((4.0, 5.0, -1.0))
    velocity = np.asarray(MOVING.linear_m_s) + np.cross(MOVING.angular_rad_s, point)
    there = MOVING.at(offset)
    same = np.asarray(there.linear_m_s) + np.cross(there.angular_rad_s, point - offset)
    np.testing.assert_allclose(same, velocity)


def test_motion_when_turned_keeps_its_speed_and_its_own_taken_off_is_rest() -> None:
    turned = MOVING.turned(rotation_from_rpy(0.3, 0.2, 0.1))
    assert turned.speed_m_s == pytest.approx(MOVING.speed_m_s)
    assert MOVING.minus(MOVING) == AT_REST
