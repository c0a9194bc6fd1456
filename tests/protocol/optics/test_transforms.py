"""Rotations and poses in SAE: directions, order, pitch of 90 degrees, composition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy

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
    again = rotation_from_rpy(*Pose(rotation, np.zeros(3)).to_rpy())
    np.testing.assert_allclose(again, rotation, atol=EXACT)


@pytest.mark.parametrize("pitch", [QUARTER, -QUARTER])
def test_rpy_when_pitch_is_90_degrees_gives_all_turning_to_yaw(pitch: float) -> None:
    rotation = rotation_from_rpy(0.4, pitch, 1.0)
    roll, read_pitch, yaw = Pose(rotation, np.zeros(3)).to_rpy()
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


def multiply_quaternions(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Hamilton's product of two quaternions in the order x, y, z, w."""
    return np.array(
        [*(p[3] * q[:3] + q[3] * p[:3] + np.cross(p[:3], q[:3])), p[3] * q[3] - p[:3] @ q[:3]]
    )


def quaternion_of_turn(axis: tuple[float, ...], angle: float) -> np.ndarray:
    unit = np.array(axis) / np.linalg.norm(axis)
    return np.array([*(math.sin(0.5 * angle) * unit), math.cos(0.5 * angle)])


def rotation_of_turn(axis: tuple[float, ...], angle: float) -> np.ndarray:
    """Rotation (3, 3) by the formula of Rodrigues."""
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


@settings(derandomize=True, max_examples=200, deadline=None)
@given(ANGLES, ANGLES, ANGLES)
def test_quaternion_of_three_angles_is_the_product_of_their_half_turns(
    roll: float, pitch: float, yaw: float
) -> None:
    expected = multiply_quaternions(
        quaternion_of_turn((0, 0, 1), yaw),
        multiply_quaternions(
            quaternion_of_turn((0, 1, 0), pitch), quaternion_of_turn((1, 0, 0), roll)
        ),
    )
    quaternion = Pose.from_rpy((1.0, 2.0, 3.0), (roll, pitch, yaw)).quaternion
    assert quaternion[3] >= 0.0
    # Two quaternions, of opposite signs, are one rotation: near a half turn w is rounding.
    sign = math.copysign(1.0, quaternion @ expected)
    np.testing.assert_allclose(quaternion, sign * expected, atol=EXACT)


AXES = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (-1, 2, 0), (0, -3, 1), (1, -1e-9, 1e-9)]


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("from_half_turn", [0.0, 1e-15, 1e-9, 1e-3, -1e-9, -1e-3, 1.0])
def test_quaternion_of_a_turn_near_180_degrees_keeps_all_digits(
    axis: tuple[float, ...], from_half_turn: float
) -> None:
    quaternion = Pose(rotation_of_turn(axis, math.pi + from_half_turn), np.zeros(3)).quaternion
    expected = quaternion_of_turn(axis, math.pi + from_half_turn)
    sign = math.copysign(1.0, quaternion @ expected)
    np.testing.assert_allclose(quaternion, sign * expected, atol=EXACT)


@pytest.mark.parametrize(
    ("diagonal", "expected"),
    [
        ((1, 1, 1), (0, 0, 0, 1)),
        ((1, -1, -1), (1, 0, 0, 0)),
        ((-1, 1, -1), (0, 1, 0, 0)),
        ((-1, -1, 1), (0, 0, 1, 0)),
    ],
)
def test_quaternion_of_the_identity_and_of_exact_half_turns(
    diagonal: tuple[int, ...], expected: tuple[int, ...]
) -> None:
    assert tuple(Pose(np.diag(np.array(diagonal, float)), np.zeros(3)).quaternion) == expected


def test_quaternion_of_a_half_turn_starts_with_a_positive_component() -> None:
    # About (-1, 2, 0) / sqrt(5), exactly symmetric: w is 0.
    half_turn = np.array([[-0.6, -0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, -1.0]])
    x, y, z, w = Pose(half_turn, np.zeros(3)).quaternion
    assert (x, y) == (pytest.approx(math.sqrt(0.2)), pytest.approx(-math.sqrt(0.8)))
    assert (z, w) == (0.0, 0.0)
