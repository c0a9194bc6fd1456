"""Items of world files: shapes, poses and materials."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from catoptra_server.config.world_file import read_world
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Material,
    MeshFile,
    Rectangle,
    Ring,
    SphereBand,
    World,
)
from helpers.configs import write_small_world


def read_world_text(folder: Path, *lines: str) -> World:
    return read_world(write_small_world(folder, *lines))[0]


@pytest.mark.parametrize(
    ("line", "shape"),
    [
        ("Boxes=(Size=(X=1,Y=2,Z=3))", Box((1.0, 2.0, 3.0))),
        ("Cylinders=(Radius=0.1,Height=2,Sectors=12)", Cylinder(0.1, 2.0, 12)),
        ("Rectangles=(Size=(X=1,Y=2),Repeat=(X=3,Y=4))", Rectangle((1.0, 2.0), (3.0, 4.0))),
        ("Rings=(InnerRadius=0,OuterRadius=1)", Ring(0.0, 1.0)),
        (
            "SphereBands=(Radius=2,From=90,To=180,Sectors=8,Rings=3)",
            SphereBand(2.0, 0.5 * math.pi, math.pi, 8, 3),
        ),
    ],
)
def test_item_when_written_is_its_shape(tmp_path: Path, line: str, shape: object) -> None:
    assert shape in [item.shape for item in read_world_text(tmp_path, line).items]


def test_item_when_placed_has_pose_colour_and_name(tmp_path: Path) -> None:
    line = (
        'Cylinders=(Name="Post",Radius=1,Height=1,Position=(X=1,Y=2,Z=-3),'
        "Direction=(Z=1.5),Colour=(R=255,B=0),Unlit=true,CastShadow=false)"
    )
    item = read_world_text(tmp_path, line).items[-1]
    assert item.name == "Post"
    assert item.world_from_item.translation.tolist() == [1.0, 2.0, -3.0]
    assert item.world_from_item.to_rpy() == pytest.approx((0.0, 0.0, 1.5))
    assert item.material == Material((1.0, 0.0, 0.0), unlit=True)
    assert not item.casts_shadows


def test_mesh_when_no_material_is_stated_keeps_its_own(tmp_path: Path) -> None:
    (tmp_path / "m.stl").touch()
    item = read_world_text(tmp_path, "Meshes=(File=m.stl,Scale=0.01,Up=Y)").items[-1]
    assert item.shape == MeshFile(tmp_path / "m.stl", 0.01, "y")
    assert item.material is None
    assert item.unlit is None


@pytest.mark.parametrize("unlit", [True, False])
def test_lights_of_a_mesh_with_its_own_material_are_switched_by_the_world(
    tmp_path: Path, unlit: bool
) -> None:
    (tmp_path / "m.stl").touch()
    path = write_small_world(tmp_path, f"Meshes=(File=m.stl,Unlit={unlit})")
    world, file = read_world(path)
    assert world.items[-1].material is None
    assert world.items[-1].unlit is unlit
    assert file.unknown_names() == []


def test_unlit_beside_a_colour_belongs_to_the_material(tmp_path: Path) -> None:
    (tmp_path / "m.stl").touch()
    item = read_world_text(tmp_path, "Meshes=(File=m.stl,Colour=(R=0,G=0,B=0),Unlit=true)").items[
        -1
    ]
    assert item.material == Material((0.0, 0.0, 0.0), unlit=True)
    assert item.unlit is None


def test_class_of_an_item_is_that_of_its_line(tmp_path: Path) -> None:
    line = 'Boxes=(Size=(X=1,Y=2,Z=3),Name="door",Class="furniture")'
    world = read_world_text(tmp_path, line, "Boxes=(Size=(X=1,Y=1,Z=1))")
    assert [item.class_name for item in world.items[-2:]] == ["furniture", ""]
