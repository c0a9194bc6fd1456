"""Rotations and poses in SAE: directions, order, pitch of 90 degrees, composition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy, rpy_from_rotation

QUARTER = 0.5 * math.pi
ANGLES = st.floats(-math.pi, math.pi)
# A few roundings of numbers near 1.
EXACT = 4e-15


@pytest.mark.parametrize(
    ("rpy", "of_x", "of_y"),
    [
        ((0.0, 0.0, QUARTER), (0, 1, 0), (-1, 0, 0)),  # clockwise from above: nose to the right
        ((0.0, QUARTER, 0.0), (0, 0, -1), (0, 1, 0)),  # nose up
        ((QUARTER, 0.0, 0.0), (1, 0, 0), (0, 0, 1)),  # right side down
    ],
)
def test_rotation_when_of_one_angle_turns_as_in_sae(
    rpy: tuple[float, float, float], of_x: tuple[int, ...], of_y: tuple[int, ...]
) -> None:
    rotation = rotation_from_rpy(*rpy)
    np.testing.assert_allclose(rotation[:, 0], of_x, atol=EXACT)
    np.testing.assert_allclose(rotation[:, 1], of_y, atol=EXACT)


def test_rotation_when_of_three_angles_is_roll_then_pitch_then_yaw_about_fixed_axes() -> None:
    roll, pitch, yaw = 0.3, -0.5, 1.1
    steps = (
        rotation_from_rpy(0, 0, yaw)
        @ rotation_from_rpy(0, pitch, 0)
        @ rotation_from_rpy(roll, 0, 0)
    )
    np.testing.assert_allclose(rotation_from_rpy(roll, pitch, yaw), steps, atol=EXACT)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(ANGLES, st.floats(-QUARTER, QUARTER), ANGLES)
def test_rpy_when_read_back_is_the_same_rotation(roll: float, pitch: float, yaw: float) -> None:
    rotation = rotation_from_rpy(roll, pitch, yaw)
    # Near the pole the angles are ill-conditioned, the rotation that they describe is not: the
    # two tiny entries lose digits there.
    again = rotation_from_rpy(*rpy_from_rotation(rotation))
    np.testing.assert_allclose(again, rotation, atol=EXACT)


@pytest.mark.parametrize("pitch", [QUARTER, -QUARTER])
def test_rpy_when_pitch_is_90_degrees_gives_all_turning_to_yaw(pitch: float) -> None:
    rotation = rotation_from_rpy(0.4, pitch, 1.0)
    roll, read_pitch, yaw = rpy_from_rotation(rotation)
    assert (roll, read_pitch) == (0.0, pytest.approx(pitch, abs=EXACT))
    np.testing.assert_allclose(rotation_from_rpy(roll, read_pitch, yaw), rotation, atol=EXACT)


def test_pose_when_composed_applies_the_inner_one_first() -> None:
    world_from_robot = Pose.from_rpy((1.0, 2.0, 0.0), (0.0, 0.0, QUARTER))
    robot_from_mirror = Pose.from_rpy((0.5, 0.0, -0.4))
    composed = world_from_robot @ robot_from_mirror
    np.testing.assert_allclose(composed.translation, (1.0, 2.5, -0.4), atol=EXACT)
    point = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    one_by_one = world_from_robot.transform_points(robot_from_mirror.transform_points(point))
    np.testing.assert_allclose(composed.transform_points(point), one_by_one, atol=EXACT)


def test_pose_when_inverted_undoes_itself() -> None:
    pose = Pose.from_rpy((1.0, -2.0, 3.0), (0.3, -0.5, 1.1))
    both = pose @ pose.inverse()
    np.testing.assert_allclose(both.rotation, np.eye(3), atol=EXACT)
    np.testing.assert_allclose(both.translation, 0.0, atol=EXACT)


def test_direction_when_moved_to_the_parent_is_not_translated() -> None:
    pose = Pose.from_rpy((9.0, 9.0, 9.0), (0.0, 0.0, QUARTER))
    np.testing.assert_allclose(pose.rotate_directions(np.array([1.0, 0, 0])), (0, 1, 0), atol=EXACT)


def test_pose_when_made_cannot_be_changed() -> None:
    pose = Pose.identity()
    with pytest.raises(ValueError, match="read-only"):
        pose.translation[0] = 1.0


def test_pose_when_made_of_an_array_leaves_the_array_writable() -> None:
    position = np.zeros(3)
    Pose.from_rpy(position)
    position[0] = 1.0
