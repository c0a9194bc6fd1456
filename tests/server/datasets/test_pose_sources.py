"""Poses of samples: given, random, driven; a function of recipe and index."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.poses import PoseSource, check_given_poses, find_place
from helpers.configs import find_line_number
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe


def test_drive_moves_by_its_wheels_and_each_sample_leads_to_the_next(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    source = PoseSource(stage)
    motions = [source.find_motion(find_place(stage.recipe, index)) for index in range(2)]
    first, second = motions
    assert first.next is not None
    assert second.next is not None
    np.testing.assert_array_equal(
        first.next.world_from_robot.translation, second.now.world_from_robot.translation
    )
    assert second.now.time_s - first.now.time_s == pytest.approx(0.2)
    moved = second.next.world_from_robot.translation - second.now.world_from_robot.translation
    # The largest wheel speed of the robot, 5.385 rad/s on wheels of 0.13 m, and slip.
    assert 0.0 < np.linalg.norm(moved) < 0.2 * 5.385 * 0.13 * 1.2


def test_drive_when_taken_up_in_the_middle_is_the_same(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    whole, late = PoseSource(stage), PoseSource(stage)
    for index in range(6):
        whole.find_motion(find_place(stage.recipe, index))
    for index in (5, 3):
        place = find_place(stage.recipe, index)
        np.testing.assert_array_equal(
            whole.find_motion(place).now.world_from_robot.translation,
            late.find_motion(place).now.world_from_robot.translation,
        )


def test_path_has_a_speed_and_ends_without_a_next_pose(tmp_path: Path) -> None:
    lines = ("Points=(X=0,Y=0)", "Points=(X=0,Y=-0.2)", "Speed=0.5")
    path = write_recipe(tmp_path, "[Catoptra.PathPoses]", *lines, samples=0, poses="path")
    stage = stage_recipe(path)
    motions = [PoseSource(stage).find_motion(find_place(stage.recipe, i)) for i in range(3)]
    np.testing.assert_allclose(motions[1].now.twist.linear_m_s, (0.0, -0.5, 0.0), atol=1e-12)
    assert motions[1].now.time_s == pytest.approx(0.2)
    assert motions[1].next is not None
    assert motions[2].next is None


def test_random_motion_has_the_speed_of_its_range(tmp_path: Path) -> None:
    lines = ("Speed=(Min=1,Max=2)", "YawRate=(Min=-3,Max=-2)")
    stage = stage_recipe(write_recipe(tmp_path, "[Catoptra.RandomPoses]", *lines))
    motion = PoseSource(stage).find_motion(find_place(stage.recipe, 3))
    assert motion.next is None
    assert 1.0 <= math.hypot(*motion.now.twist.linear_m_s) <= 2.0
    assert -3.0 <= motion.now.twist.angular_rad_s[2] <= -2.0


def test_given_pose_inside_a_wall_is_named_with_file_and_line(tmp_path: Path) -> None:
    points = ("Points=(X=0,Y=0)", "Points=(X=1,Y=0)", "Points=(X=1,Y=1.2)")
    path = write_recipe(tmp_path, "[Catoptra.PathPoses]", *points, samples=0, poses="path")
    line = find_line_number(path, "Y=1.2")
    with pytest.raises(
        CatoptraError, match=rf"recipe.ini:{line}: pose \d+ \(X=1, Y=0\.\d+, Yaw=1.5708\) is not"
    ):
        check_given_poses(stage_recipe(path))


def test_free_given_poses_pass(tmp_path: Path) -> None:
    grid = ("X=(Min=-1,Max=0,Count=2)", "Y=(Min=0,Max=0,Count=1)")
    path = write_recipe(tmp_path, "[Catoptra.GridPoses]", *grid, samples=0, poses="grid")
    check_given_poses(stage_recipe(path))
