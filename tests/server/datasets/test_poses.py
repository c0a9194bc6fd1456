"""Place, pose, motion and light of each sample, by recipe and index; free space of robots."""

from __future__ import annotations

import math
from collections import Counter
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError, ConfigError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.datasets.poses import (
    PoseSource,
    check_given_poses,
    draw_brightness,
    find_place,
    random_source,
)
from catoptra_server.datasets.recipe import DrivePoses, GivenPoses, RandomPoses
from catoptra_server.datasets.recipe_file import read_recipe
from helpers.configs import find_line_number
from helpers.dataset_recipes import CAMERA, FISHEYE, stage_recipe, write_drive, write_recipe


def test_random_poses_go_through_all_worlds_and_cameras(tmp_path: Path) -> None:
    recipe = read_recipe(
        write_recipe(tmp_path, cameras=(CAMERA, FISHEYE), lines=("Worlds=warehouse",))
    )
    places = [find_place(recipe, index) for index in range(8)]
    assert [(p.world, p.camera) for p in places] == [(0, 0), (0, 1), (1, 0), (1, 1)] * 2
    assert [p.sequence for p in places] == list(range(8))


def test_samples_of_a_drive_follow_each_other(tmp_path: Path) -> None:
    recipe = read_recipe(write_drive(tmp_path))
    places = [find_place(recipe, index) for index in range(6)]
    assert [(p.sequence, p.step, p.camera) for p in places] == [
        *((0, 0, 0), (0, 1, 0)),
        *((1, 0, 1), (1, 1, 1)),
        *((2, 0, 0), (2, 1, 0)),
    ]


def test_brightness_takes_all_levels_and_depends_on_the_index_alone(tmp_path: Path) -> None:
    recipe = read_recipe(write_drive(tmp_path))
    levels = [draw_brightness(recipe, index) for index in range(60)]
    assert set(Counter(levels)) == {0.5, 1.0, 1.5}
    assert draw_brightness(recipe, 17) == levels[17]


def test_random_numbers_of_purposes_are_independent(tmp_path: Path) -> None:
    recipe = read_recipe(write_recipe(tmp_path))
    drawn = {
        random_source(recipe, purpose).generator(index).random()
        for purpose in ("pose", "effects")
        for index in range(5)
    }
    assert len(drawn) == 10


WORLD = """[Catoptra.World]
Rectangles=(Name="Floor",Position=(X=0,Y=0,Z=0),Size=(X=20,Y=20))
Boxes=(Name="Wall",Size=(X=0.1,Y=20,Z=2),Position=(X=3,Y=0,Z=-1))
Boxes=(Name="Block",Size=(X=4,Y=4,Z=3),Position=(X=-5,Y=0,Z=-1.5))
Lights=(Type=Hemisphere,Up=(R=200,G=200,B=200),Down=(R=100,G=100,B=100))
"""


def write_room(folder: Path, *section: str, poses: str = "random", samples: int = 60) -> Path:
    """Write a recipe of poses in the world above."""
    (folder / "room.ini").write_text(WORLD, encoding="utf-8")
    head = f"[Catoptra.{poses.capitalize()}Poses]"
    return write_recipe(folder, head, *section, world="room.ini", poses=poses, samples=samples)


def grid_of_one(x_m: float, y_m: float) -> tuple[str, ...]:
    """Section of a grid of a single pose."""
    return f"X=(Min={x_m},Max={x_m},Count=1)", f"Y=(Min={y_m},Max={y_m},Count=1)"


@pytest.mark.parametrize(
    ("x_m", "y_m", "fault"),
    [
        (0.0, 0.0, ""),
        (3.0, 1.0, "touches"),
        (2.75, 1.0, "touches"),
        (2.6, 1.0, ""),
        (-5.0, 0.0, "inside a solid"),
        (-3.0, 0.0, "touches"),
        (0.0, 11.0, "no floor"),
    ],
)
def test_pose_is_free_beside_walls_and_on_the_floor_alone(
    tmp_path: Path, x_m: float, y_m: float, fault: str
) -> None:
    stage = stage_recipe(write_room(tmp_path, *grid_of_one(x_m, y_m), poses="grid", samples=1))
    with pytest.raises(CatoptraError, match=fault) if fault else nullcontext():
        check_given_poses(stage)


def test_world_without_any_floor_needs_none(tmp_path: Path) -> None:
    section = ("[Catoptra.GridPoses]", *grid_of_one(0.0, 0.0))
    path = write_recipe(tmp_path, *section, world="incidence_rings", poses="grid", samples=1)
    check_given_poses(stage_recipe(path))


def find_poses(path: Path, number: int) -> list[Floats]:
    """Positions of the first samples of a recipe."""
    stage = stage_recipe(path)
    source = PoseSource(stage)
    places = [find_place(stage.recipe, index) for index in range(number)]
    return [source.find_motion(place).now.world_from_robot.translation for place in places]


def test_clearance_counts(tmp_path: Path) -> None:
    section = ("X=2.6", "Y=1", "Yaw=0", "MaxTries=1")
    find_poses(write_room(tmp_path, *section, "Clearance=0.05"), 1)
    with pytest.raises(CatoptraError, match="touches"):
        find_poses(write_room(tmp_path, *section, "Clearance=0.2"), 1)


def test_random_poses_are_free_and_everywhere(tmp_path: Path) -> None:
    found = find_poses(write_room(tmp_path), 60)
    # No robot is nearer than the half of its width to the wall, or has its centre in the block.
    assert all(
        abs(x_m - 3.0) > 0.25 and not (abs(x_m + 5.0) < 2.25 and abs(y_m) < 2.25)
        for x_m, y_m, _ in found
    )
    assert {(x_m > 3.0, y_m > 0.0) for x_m, y_m, _ in found} == {
        (right, ahead) for right in (True, False) for ahead in (True, False)
    }


def test_no_free_space_is_an_error_that_names_the_recipe(tmp_path: Path) -> None:
    path = write_room(tmp_path, "X=(Min=-6,Max=-4)", "Y=(Min=-1,Max=1)", "MaxTries=20")
    with pytest.raises(CatoptraError, match=r"recipe.ini:\d+: no free pose for USARBot.OmniP2AT"):
        find_poses(path, 1)


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


def read_given(folder: Path, kind: str, *lines: str) -> GivenPoses:
    """Poses of a recipe with a section of one kind."""
    section = f"[Catoptra.{kind.capitalize()}Poses]"
    poses = read_recipe(write_recipe(folder, section, *lines, poses=kind)).poses
    assert isinstance(poses, GivenPoses)
    return poses


def test_grid_has_all_combinations_with_both_ends(tmp_path: Path) -> None:
    poses = read_given(
        tmp_path,
        "grid",
        "X=(Min=-1,Max=1,Count=3)",
        "Y=(Min=2,Max=2,Count=1)",
        "Yaw=(Min=0,Max=3,Count=2)",
    )
    found = [(p.pose.x_m, p.pose.y_m, p.pose.yaw_rad) for p in poses.poses]
    assert found == [(x, 2.0, yaw) for x in (-1.0, 0.0, 1.0) for yaw in (0.0, 3.0)]
    assert not poses.is_path


def test_path_is_evenly_spaced_around_corners(tmp_path: Path) -> None:
    points = ("Points=(X=0,Y=0)", "Points=(X=1,Y=0)", "Points=(X=1,Y=1)")
    poses = read_given(tmp_path, "path", *points, "Spacing=0.4", "Speed=0.8")
    places = np.array([(p.pose.x_m, p.pose.y_m) for p in poses.poses])
    expected = [(0, 0), (0.4, 0), (0.8, 0), (1, 0.2), (1, 0.6), (1, 1)]
    np.testing.assert_allclose(places, expected, atol=1e-12)
    assert [p.pose.yaw_rad for p in poses.poses] == [0.0] * 3 + [math.pi / 2] * 3
    assert poses.interval_s == pytest.approx(0.5)
    # An error of a pose names the line of the point that it leads to.
    assert poses.poses[3].where.line == poses.poses[0].where.line + 1


def test_drive_has_a_start_and_wheel_speeds(tmp_path: Path) -> None:
    section = ("[Catoptra.DrivePoses]", "Samples=5", "Interval=0.1", "WheelSpeed=(Min=1,Max=2)")
    poses = read_recipe(write_recipe(tmp_path, *section, poses="drive")).poses
    assert isinstance(poses, DrivePoses)
    assert isinstance(poses.start, RandomPoses)
    assert (poses.num_samples, poses.interval_s) == (5, 0.1)
    assert (poses.wheel_speed_rad_s.low, poses.wheel_speed_rad_s.high) == (1.0, 2.0)


@pytest.mark.parametrize(
    ("kind", "lines", "message"),
    [
        ("grid", ("X=(Min=1,Max=0,Count=2)", "Y=(Min=0,Max=0,Count=1)"), "Min at most Max"),
        ("grid", ("X=(Min=0,Max=1,Count=0)", "Y=(Min=0,Max=0,Count=1)"), "Count"),
        ("grid", ("Y=(Min=0,Max=0,Count=1)",), "X"),
        ("path", ("Points=(X=0,Y=0)",), "at least two points"),
        ("path", ("Points=(X=0,Y=0)", "Points=(X=0,Y=0)"), "apart"),
        ("path", ("Points=(X=0,Y=0)", "Points=(X=9,Y=0)", "Spacing=0"), "Spacing"),
        ("drive", ("Interval=0.05",), "multiple of the tick"),
        ("drive", ("Hold=(Min=3,Max=1)",), "Min at most Max"),
        ("random", ("Clearance=-1",), "Clearance"),
        ("random", ("Yaw=(Min=1,Max=0)",), "Min at most Max"),
    ],
)
def test_wrong_poses_are_errors(
    tmp_path: Path, kind: str, lines: tuple[str, ...], message: str
) -> None:
    section = f"[Catoptra.{kind.capitalize()}Poses]"
    with pytest.raises(ConfigError, match=message):
        read_recipe(write_recipe(tmp_path, section, *lines, poses=kind))
