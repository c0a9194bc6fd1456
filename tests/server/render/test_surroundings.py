from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.render.surroundings import Surroundings, axis_of, turn_to
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import build_scene
from helpers.effects import CAMERA
from helpers.ranges import FLOOR
from helpers.worlds import VIEW, room

ROOM = build_scene(room())


@pytest.mark.parametrize(
    "axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.48, -0.6, -0.64)]
)
def test_turn_leads_an_axis_to_z_and_is_a_rotation(axis: tuple[float, float, float]) -> None:
    turn = turn_to(axis)
    assert turn @ np.array(axis) == pytest.approx([0.0, 0.0, 1.0])
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_axis_of_robots_that_turn_where_they_stand_is_the_same() -> None:
    axes = {axis_of(Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, yaw))) for yaw in (0.0, 1.0, -2.5)}
    assert axes == {(0.0, 0.0, 1.0)}


def test_distances_do_not_depend_on_what_was_asked_before() -> None:
    rng = np.random.default_rng(3)
    poses = [Pose.from_rpy((*rng.uniform(-1.5, 1.5, 2), -0.5)) for _ in range(10)]
    known = Surroundings(ROOM)
    forth = [known.nearest_m(pose, CAMERA) for pose in poses]
    assert forth == [Surroundings(ROOM).nearest_m(pose, CAMERA) for pose in poses]


def test_distances_when_a_robot_drives_a_little_are_found_once() -> None:
    surroundings = Surroundings(ROOM)
    begin = surroundings.nearest_m(VIEW.world_from_mirror, CAMERA)
    found = surroundings.questions_asked
    aside = np.array((0.002, 0.001, 0.0))
    near = replace(VIEW.world_from_mirror, translation=VIEW.world_from_mirror.translation + aside)
    assert surroundings.nearest_m(near, CAMERA) == begin
    assert surroundings.questions_asked == found


def test_open_floor_is_known_for_metres_around() -> None:
    surroundings = Surroundings(build_scene(FLOOR))
    for x in np.linspace(0.0, 10.0, 101):
        nearest = surroundings.nearest_m(Pose.from_rpy((x, 0.0, -0.6)), CAMERA)
        assert 0.5 < nearest[0] <= 0.6
    assert surroundings.questions_asked < 30


def test_empty_world_is_infinitely_far() -> None:
    nearest = Surroundings(build_scene(World("empty", ()))).nearest_m(Pose.identity(), CAMERA)
    assert set(nearest) == {math.inf}
