"""Lights, motion and names of a world; sRGB against the numbers of IEC 61966-2-1."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy
from catoptra_server.world.world_description import (
    AT_REST,
    MAX_LIGHT,
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    PointLight,
    SceneObject,
    Twist,
    integrate_poses,
    linear_from_srgb,
    srgb_from_linear,
)

BLACK = (0.0, 0.0, 0.0)


@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf, 2.0 * MAX_LIGHT])
def test_light_out_of_range_is_rejected(value: float) -> None:
    colour = (0.5, value, 0.5)
    with pytest.raises(DomainError, match="point light"):
        PointLight(BLACK, colour)
    with pytest.raises(DomainError, match="directional light"):
        DirectionalLight((0.0, 0.0, 1.0), colour)
    with pytest.raises(DomainError, match="hemisphere light"):
        HemisphereLight(BLACK, colour)


def test_brightest_light_is_accepted() -> None:
    assert PointLight(BLACK, (MAX_LIGHT, 0.0, 0.0)).intensity[0] == MAX_LIGHT


@pytest.mark.parametrize(
    ("encoded", "linear"),
    [(0.0, 0.0), (0.04045, 0.0031308), (0.5, 0.21404), (0.735357, 0.5), (1.0, 1.0)],
)
def test_decoded_values_are_the_standards(encoded: float, linear: float) -> None:
    # The standard gives five digits.
    assert linear_from_srgb(np.array(encoded)) == pytest.approx(linear, abs=6e-6)


def test_256_levels_survive_decoding_and_encoding() -> None:
    levels = np.arange(256) / 255.0
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(levels)), levels, atol=1e-7)


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


def rotate_about(vector: np.ndarray) -> np.ndarray:
    """Rodrigues' formula for a single vector, term by term."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    skew = np.cross(np.eye(3), vector / angle)
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


# Zero, what vanishes when squared, and turns by many revolutions.
SPEEDS = st.one_of(st.sampled_from((0.0, -0.0, 1e-300, -1e-160, 1e6)), st.floats(-40.0, 40.0))
VECTORS = st.tuples(SPEEDS, SPEEDS, SPEEDS)


@given(st.lists(st.builds(Twist, VECTORS, VECTORS), max_size=9), st.floats(-0.1, 0.1))
def test_poses_integrated_together_have_the_bits_of_each_alone(
    twists: list[Twist], time_s: float
) -> None:
    poses = [Pose.from_rpy((k, 2.0, 0.1), (0.1, -k, 3.0 * k)) for k in range(len(twists))]
    moved = integrate_poses([*zip(poses, twists, strict=True)], time_s)
    for pose, twist, together in zip(poses, twists, moved, strict=True):
        assert (together is pose) == (twist == AT_REST)
        alone = twist.integrate_pose(pose, time_s)
        turn = rotate_about(np.asarray(twist.angular_rad_s) * time_s)
        np.testing.assert_array_equal(together.rotation, alone.rotation)
        # The last place of a length in radians.
        turned_rad = float(np.linalg.norm(twist.angular_rad_s)) * time_s
        np.testing.assert_allclose(
            alone.rotation, turn @ pose.rotation, rtol=0.0, atol=1e-15 * (8.0 + abs(turned_rad))
        )
        for one in (together, alone):
            np.testing.assert_array_equal(
                one.translation, pose.translation + np.asarray(twist.linear_m_s) * time_s
            )


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


ITEM = Item("office", Box((1.0, 1.0, 1.0)), Pose.identity(), None)


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        ("", SceneObject("office", "object")),
        ("chair", SceneObject("office/chair", "chair")),
        ("chair.001", SceneObject("office/chair.001", "chair")),
        ("Desk_12", SceneObject("office/Desk_12", "Desk")),
        ("007", SceneObject("office/007", "object")),
    ],
)
def test_node_names_object_and_class(node: str, expected: SceneObject) -> None:
    assert SceneObject.from_item(ITEM, node) == expected


def test_class_of_the_world_file_overrides_the_node() -> None:
    item = Item("office", ITEM.shape, ITEM.world_from_item, None, class_name="furniture")
    assert SceneObject.from_item(item, "chair") == SceneObject("office/chair", "furniture")
