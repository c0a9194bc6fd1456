"""World files: the bundled ones, each kind of line, and the errors of broken ones."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.usarsim.reports import StartPose, StartPoses, line_from_report
from catoptra_server.config.world_file import read_world
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    DirectionalLight,
    GpsOrigin,
    HemisphereLight,
    Material,
    MeshFile,
    PointLight,
    Rectangle,
    RfidTag,
    Ring,
    SphereBand,
    Vector3,
    Victim,
    World,
)
from helpers.configs import FIELD, WORLDS, write_small_world


def read_world_text(folder: Path, *lines: str) -> World:
    return read_world(write_small_world(folder, *lines))[0]


@pytest.mark.parametrize("path", sorted(WORLDS.glob("*.ini")), ids=lambda path: path.name)
def test_bundled_world_when_read_has_no_unknown_key(path: Path) -> None:
    world, file = read_world(path)
    assert file.unknown_names() == []
    scene = build_scene(world)
    assert len(scene) > 0
    assert np.isfinite(scene.corners).all()


def test_field_when_read_is_the_four_legged_one_of_2006() -> None:
    world, _ = read_world(FIELD)
    assert world.name == "DM-spqrSoccer2006_250"
    kinds = [landmark.kind for landmark in world.landmarks]
    assert (kinds.count("goal"), kinds.count("beacon")) == (2, 4)
    # The 2006 rules: beacons 1.35 m either side of halfway, goals 0.8 m wide on lines 5.4 m apart.
    assert {abs(m.x_m) for m in world.landmarks if m.kind == "beacon"} == {1.35}
    assert {(abs(m.x_m), m.width_m) for m in world.landmarks if m.kind == "goal"} == {(2.7, 0.8)}


def test_start_when_written_is_a_pose(tmp_path: Path) -> None:
    line = 'PlayerStarts=(Tag="A",Location=(X=1,Y=2,Z=3),Rotation=(Z=1.5))'
    assert read_world_text(tmp_path, line).starts == (
        StartPose("A", (1.0, 2.0, 3.0), (0.0, 0.0, 1.5)),
    )


def test_name_when_missing_is_the_file_s(tmp_path: Path) -> None:
    assert read_world_text(tmp_path).name == "world"


@pytest.mark.parametrize(
    ("line", "key", "expected"),
    [
        ("Boxes=(Size=(X=1,Y=0,Z=1))", "Size.Y", "from 1e-06"),
        ("Boxes=(Size=(X=1e9,Y=1,Z=1))", "Size.X", "to 100000"),
        ("Cylinders=(Radius=0,Height=1)", "Cylinders.Radius", "from 1e-06 to 100000"),
        ("Boxes=(Position=(X=1))", "Boxes.Size", "a struct"),
        ("Boxes=1", "Boxes", "a struct"),
        ("Boxes=(Size=(X=1,Y=1,Z=1),Position=(X=1e300))", "Position.X", "from -100000"),
        ("Cylinders=(Radius=1,Height=1,Sectors=2)", "Cylinders.Sectors", "from 3 to 4096"),
        ("Rectangles=(Size=(X=1))", "Size.Y", "missing"),
        ("Boxes=(Size=(X=1,Y=1,Z=1),Colour=(R=256))", "Colour.R", "from 0 to 255"),
        ("Boxes=(Size=(X=1,Y=1,Z=1),CastShadow=2)", "Boxes.CastShadow", "true or false"),
        ("Meshes=(Scale=1)", "Meshes.File", "missing"),
        ("Landmarks=no.csv", "Catoptra.World.Landmarks", "a file that exists"),
        ("Lights=(Type=Rectangle,Position=(X=1))", "Lights.Type", "LightBake=on"),
        ("Lights=(Type=Point,Position=(X=1),Brightness=-1)", "Lights.Brightness", "from 0"),
        ('PlayerStarts=(Tag="a}",Location=(X=0))', "PlayerStarts.Tag", "one word"),
        ("PlayerStarts=(Location=(X=0))", "PlayerStarts.Tag", "missing"),
        ('PlayerStarts=(Tag="A")', "PlayerStarts.Location", "missing"),
        ('Name="a {b}"', "Catoptra.World.Name", "clients can receive"),
        ('Name="€uro"', "Catoptra.World.Name", "clients can receive"),
        ('Name="' + 5000 * "x" + '"', "Catoptra.World.Name", "at most 4095"),
        ("Background=(R=-1)", "Background.R", "from 0 to 255"),
    ],
)
def test_world_when_broken_names_file_line_key_and_expectation(
    tmp_path: Path, line: str, key: str, expected: str
) -> None:
    path = write_small_world(tmp_path, "; the next line is wrong", line)
    with pytest.raises(ConfigError) as caught:
        read_world(path)
    error = caught.value
    assert (error.location.file, error.location.line) == (str(path), 4)
    assert error.key == key
    assert expected in error.expected


def test_starts_when_sixty_fit_a_line_of_the_protocol(tmp_path: Path) -> None:
    world = read_world_text(
        tmp_path, *(f"PlayerStarts=(Tag=P{i:02},Location=(X=-9.5))" for i in range(60))
    )
    assert len(line_from_report(StartPoses(world.starts))) <= 4095


def test_starts_when_too_many_for_a_line_are_rejected(tmp_path: Path) -> None:
    lines = [f"PlayerStarts=(Tag=Start{i},Location=(X=0))" for i in range(90)]
    with pytest.raises(ConfigError, match=r"PlayerStarts=.*at most 4095"):
        read_world_text(tmp_path, *lines)


def test_member_when_misspelt_is_reported_as_unknown(tmp_path: Path) -> None:
    path = write_small_world(tmp_path, "Boxes=(Size=(X=1,Y=1,Z=1,W=1),Color=(R=255))", "Nmae=x")
    _, file = read_world(path)
    assert sorted(entry.key for entry in file.unknown_names()) == ["Color", "Nmae", "W"]


_VALUES = st.one_of(
    st.floats(width=64).map(repr),
    st.text(alphabet=st.sampled_from("()=,\"'aX1 \0é{}"), max_size=20),
    st.sampled_from(["(X=1,Y=1,Z=1)", "(Size=(X=1,Y=1,Z=1))", "(Tag=A,Location=(X=1))"]),
)
_KEYS = st.sampled_from(
    ["Name", "Boxes", "Rings", "Lights", "PlayerStarts", "Background", "Landmarks", "Meshes"]
)


def world_or_error(path: Path) -> tuple[World | None, ConfigError | None]:
    try:
        return read_world(path)[0], None
    except ConfigError as error:
        return None, error


@settings(derandomize=True, max_examples=150, deadline=None)
@given(st.lists(st.tuples(_KEYS, _VALUES), max_size=4))
def test_world_when_arbitrary_is_read_or_rejected(
    tmp_path_factory: pytest.TempPathFactory, lines: list[tuple[str, str]]
) -> None:
    path = write_small_world(
        tmp_path_factory.getbasetemp(), *(f"{key}={value}" for key, value in lines)
    )
    world, error = world_or_error(path)
    assert world is None or np.isfinite(build_scene(world).corners).all()
    assert error is None or str(path) in str(error)


def test_targets_of_sensors_when_listed_are_read(tmp_path: Path) -> None:
    world = read_world_text(
        tmp_path,
        "RfidTags=(ID=1001,Position=(X=1,Y=2,Z=-0.1))",
        'Victims=(Name="Head",Position=(X=3,Y=0,Z=-0.5))',
        "GpsOrigin=(Latitude=39.1339,Longitude=-77.2166)",
    )
    assert world.rfid_tags == (RfidTag(1001, (1.0, 2.0, -0.1)),)
    assert world.victims == (Victim("Head", (3.0, 0.0, -0.5)),)
    assert world.gps_origin == GpsOrigin(39.1339, -77.2166)


def test_background_when_written_is_linear(tmp_path: Path) -> None:
    # IEC 61966-2-1: byte 188 is half of the light.
    background = read_world_text(tmp_path, "Background=(R=255,G=188)").background
    assert background == pytest.approx((1.0, 0.503, 0.0), abs=1e-3)


def test_lights_when_written_are_linear_light_times_brightness(tmp_path: Path) -> None:
    world = read_world_text(
        tmp_path,
        "Lights=(Type=Hemisphere,Up=(R=255,G=255,B=255),Down=(R=0,G=0,B=0),Brightness=0.5)",
        "Lights=(Type=Directional,Direction=(X=0,Y=0,Z=2))",
        "Lights=(Type=Point,Position=(X=1,Y=2,Z=-3),Colour=(R=255,G=0,B=0),Brightness=4)",
    )
    assert world.lights == (
        HemisphereLight((0.5, 0.5, 0.5), (0.0, 0.0, 0.0)),
        DirectionalLight((0.0, 0.0, 1.0), (1.0, 1.0, 1.0)),
        PointLight((1.0, 2.0, -3.0), (4.0, 0.0, 0.0)),
    )


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
        (
            "SphereBands=(Radius=2,From=0,To=180,Sectors=8,Rings=4,Solid=true)",
            SphereBand(2.0, 0.0, math.pi, 8, 4, is_solid=True),
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


def test_material_has_a_tile_in_metres_and_glows_in_its_colour(tmp_path: Path) -> None:
    lines = (
        "Boxes=(Size=(X=1,Y=1,Z=1),Repeat=0.5,Colour=(R=255,B=0),Emission=40)",
        "Rectangles=(Size=(X=1,Y=2),Repeat=0.25)",
    )
    glowing, tiled = read_world_text(tmp_path, "\n".join(lines)).items[-2:]
    assert glowing.material == Material((1.0, 0.0, 0.0), tile_m=0.5, emission=(40.0, 0.0, 0.0))
    assert tiled.material is not None
    assert tiled.material.tile_m == 0.25


def test_texture_by_name_has_the_tile_of_its_kind_unless_stated(tmp_path: Path) -> None:
    lines = "Boxes=(Size=(X=1,Y=1,Z=1),Texture=catoptra:brick{})"
    texts = "\n".join(lines.format(more) for more in ("", ",Repeat=0.5"))
    materials = [item.material for item in read_world_text(tmp_path, texts).items[-2:]]
    white = (1.0, 1.0, 1.0)
    assert materials == [Material(white, "brick", tile_m=side) for side in (1.0, 0.5)]
    with pytest.raises(ConfigError, match=r"one of .*catoptra:brick"):
        read_world_text(tmp_path, "Boxes=(Size=(X=1,Y=1,Z=1),Texture=catoptra:bricks)")


@pytest.mark.parametrize(
    "members",
    [
        "Repeat=0",
        "Repeat=(X=1,Y=1)",
        "Emission=-1",
        "Emission=inf",
        "Emission=nan",
        "Gloss=(F0=2)",
        "Gloss=(Roughness=-1)",
    ],
)
def test_unusable_material_is_an_error_of_one_line(tmp_path: Path, members: str) -> None:
    key = members.rsplit("(", 1)[-1] if "Gloss" in members else members
    with pytest.raises(ConfigError, match=key.split("=")[0]) as caught:
        read_world_text(tmp_path, f"Boxes=(Size=(X=1,Y=1,Z=1),{members})")
    assert "\n" not in str(caught.value)


def test_item_is_scaled_along_each_axis(tmp_path: Path) -> None:
    (tmp_path / "m.stl").touch()
    lines = "Meshes=(File=m.stl,Scale=(X=2,Y=-3))", "Boxes=(Size=(X=1,Y=1,Z=1),Scale=(Z=0.5))"
    box, mesh = read_world_text(tmp_path, "\n".join(lines)).items[-2:]
    assert (mesh.scale, box.scale) == ((2.0, -3.0, 1.0), (1.0, 1.0, 0.5))
    assert mesh.shape == MeshFile(tmp_path / "m.stl", 1.0)


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


def test_lamps_of_a_mesh_file_are_stretched_with_it(tmp_path: Path) -> None:
    lamps = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    node = {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}}
    document = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "extensionsUsed": ["KHR_lights_punctual"],
        "extensions": lamps,
    }
    (tmp_path / "lamp.gltf").write_text(json.dumps(document))

    def find_lamp(scale: str) -> Vector3:
        line = f"Meshes=(File=lamp.gltf,Up=y,Position=(X=1,Y=0,Z=0),{scale})"
        light = read_world_text(tmp_path, line).lights[-1]
        assert isinstance(light, PointLight)
        return light.position_m

    x, y, z = find_lamp("Scale=1")
    stretched = find_lamp("Scale=(X=2,Y=-3,Z=0.5)")
    assert stretched == pytest.approx((1.0 + 2.0 * (x - 1.0), -3.0 * y, 0.5 * z))


def test_mesh_file_of_many_places_is_read_once_for_its_lights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "m.gltf").write_text('{"asset": {"version": "2.0"}}')
    reads: list[str] = []
    read = Path.open

    def count(path: Path, *mode: Any, **options: Any) -> Any:
        reads.append(path.name)
        return read(path, *mode, **options)

    monkeypatch.setattr(Path, "open", count)
    lines = "\n".join(f"Meshes=(Name=m{x},File=m.gltf,Position=(X={x})))" for x in range(5))
    read_world_text(tmp_path, lines.replace(")))", "))"))
    assert reads.count("m.gltf") == 1


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
