from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.distances import (
    DistanceBoundCache,
    mirror_axis,
    rotation_to_axis,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.effect_measurement import CAMERA
from helpers.range_images import FLOOR
from helpers.worlds import CAMERA_STATE, make_test_world

ROOM = build_scene(make_test_world())


@pytest.mark.parametrize(
    "axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.48, -0.6, -0.64)]
)
def test_rotation_takes_the_axis_to_z(axis: tuple[float, float, float]) -> None:
    turn = rotation_to_axis(axis)
    assert turn @ np.array(axis) == pytest.approx([0.0, 0.0, 1.0])
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_axis_of_upright_robots_does_not_depend_on_heading() -> None:
    axes = {
        mirror_axis(Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, yaw))) for yaw in (0.0, 1.0, -2.5)
    }
    assert axes == {(0.0, 0.0, 1.0)}


def test_distances_do_not_depend_on_earlier_queries() -> None:
    rng = np.random.default_rng(3)
    poses = [Pose.from_rpy((*rng.uniform(-1.5, 1.5, 2), -0.5)) for _ in range(10)]
    known = DistanceBoundCache(ROOM)
    forth = [known.min_distances_m(pose, CAMERA) for pose in poses]
    assert forth == [DistanceBoundCache(ROOM).min_distances_m(pose, CAMERA) for pose in poses]


def test_distances_along_a_short_drive_are_evaluated_once() -> None:
    surroundings = DistanceBoundCache(ROOM)
    begin = surroundings.min_distances_m(CAMERA_STATE.world_from_mirror, CAMERA)
    found = surroundings.num_evaluations
    aside = np.array((0.002, 0.001, 0.0))
    near = replace(
        CAMERA_STATE.world_from_mirror,
        translation=CAMERA_STATE.world_from_mirror.translation + aside,
    )
    assert surroundings.min_distances_m(near, CAMERA) == begin
    assert surroundings.num_evaluations == found


def test_open_floor_shares_large_cells() -> None:
    surroundings = DistanceBoundCache(build_scene(FLOOR))
    for x in np.linspace(0.0, 10.0, 101):
        nearest = surroundings.min_distances_m(Pose.from_rpy((x, 0.0, -0.6)), CAMERA)
        assert 0.5 < nearest[0] <= 0.6
    assert surroundings.num_evaluations < 30


def test_empty_world_is_infinitely_far() -> None:
    nearest = DistanceBoundCache(build_scene(World("empty", ()))).min_distances_m(
        Pose.identity(), CAMERA
    )
    assert set(nearest) == {math.inf}
