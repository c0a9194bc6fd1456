"""Poses of recipes: grids, paths, drives."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.datasets.recipe import DrivePoses, GivenPoses, RandomPoses
from catoptra_server.datasets.recipe_file import read_recipe
from helpers.dataset_recipes import write_recipe


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
