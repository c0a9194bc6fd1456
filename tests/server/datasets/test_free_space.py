"""Free space of robots: walls, solids, floors, and random poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.poses import draw_free_pose, find_fault
from catoptra_server.datasets.recipe import RandomPoses
from catoptra_server.simulation.robot_description import PlanarPose
from helpers.dataset_recipes import stage_recipe, write_recipe

WORLD = """[Catoptra.World]
Rectangles=(Name="Floor",Position=(X=0,Y=0,Z=0),Size=(X=20,Y=20))
Boxes=(Name="Wall",Size=(X=0.1,Y=20,Z=2),Position=(X=3,Y=0,Z=-1))
Boxes=(Name="Block",Size=(X=4,Y=4,Z=3),Position=(X=-5,Y=0,Z=-1.5))
Lights=(Type=Hemisphere,Up=(R=200,G=200,B=200),Down=(R=100,G=100,B=100))
"""


def stage(folder: Path, *section: str):  # type: ignore[no-untyped-def]
    """Stage with the world above."""
    (folder / "room.ini").write_text(WORLD, encoding="utf-8")
    recipe = write_recipe(folder, "[Catoptra.RandomPoses]", *section, world="room.ini")
    return stage_recipe(recipe)


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
    loaded = stage(tmp_path)
    found = find_fault(loaded.world(0), loaded.cameras[0], PlanarPose(x_m, y_m, 0.0))
    assert (fault in found) if fault else not found


def test_world_without_any_floor_needs_none(tmp_path: Path) -> None:
    loaded = stage_recipe(write_recipe(tmp_path, world="incidence_rings"))
    assert not find_fault(loaded.world(0), loaded.cameras[0], PlanarPose(0.0, 0.0, 0.0))


def test_clearance_counts(tmp_path: Path) -> None:
    loaded = stage(tmp_path)
    pose = PlanarPose(2.6, 1.0, 0.0)
    assert not find_fault(loaded.world(0), loaded.cameras[0], pose, 0.05)
    assert find_fault(loaded.world(0), loaded.cameras[0], pose, 0.2)


def test_random_poses_are_free_and_everywhere(tmp_path: Path) -> None:
    loaded = stage(tmp_path)
    world, camera = loaded.world(0), loaded.cameras[0]
    generator = np.random.default_rng(1)
    poses = loaded.recipe.poses
    assert isinstance(poses, RandomPoses)
    found = [draw_free_pose(world, camera, poses, generator) for _ in range(60)]
    assert not any(find_fault(world, camera, pose) for pose in found)
    assert {(pose.x_m > 3.0, pose.y_m > 0.0) for pose in found} == {
        (right, ahead) for right in (True, False) for ahead in (True, False)
    }


def test_no_free_space_is_an_error_that_names_the_recipe(tmp_path: Path) -> None:
    loaded = stage(tmp_path, "X=(Min=-6,Max=-4)", "Y=(Min=-1,Max=1)", "MaxTries=20")
    with pytest.raises(CatoptraError, match=r"recipe.ini:\d+: no free pose for USARBot.OmniP2AT"):
        draw_free_pose(
            loaded.world(0), loaded.cameras[0], loaded.recipe.poses, np.random.default_rng(1)
        )
