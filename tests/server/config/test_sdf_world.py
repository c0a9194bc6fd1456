"""Worlds of Gazebo: where their shapes stand, how they look, and what is rejected."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.__main__ import main
from catoptra_server.config.sdf_world import ImportedWorld, import_sdf
from catoptra_server.config.startup import read_startup_config
from catoptra_server.config.world_file import read_world
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    DirectionalLight,
    HemisphereLight,
    Item,
    MeshFile,
    PointLight,
    Rectangle,
    SphereBand,
    World,
)
from helpers.configs import ROBOTS
from helpers.gazebo_house import SAE_FROM_SDF, matrix, write_house

BOX = "<geometry><box><size>1 2 3</size></box></geometry>"


def import_text(folder: Path, text: str, *, version: str = "1.9") -> tuple[World, ImportedWorld]:
    """World of the elements of an SDF world, as our reader has it."""
    path = folder / "arena.world"
    path.write_text(f"<sdf version='{version}'><world name='arena'>{text}</world></sdf>")
    return read_imported(path)


def read_imported(path: Path) -> tuple[World, ImportedWorld]:
    imported = import_sdf(path, [path.parent / "models"], path.parent)
    (path.parent / "out.ini").write_text(imported.text)
    world, file = read_world(path.parent / "out.ini")
    assert file.unknown_names() == []
    return world, imported


def model(visual: str, *, name: str = "m", pose: str = "", more: str = "") -> str:
    return (
        f"<model name='{name}'>{pose and f'<pose>{pose}</pose>'}{more}"
        f"<link name='l'><visual name='v'>{visual}</visual></link></model>"
    )


def test_house_stands_where_the_arithmetic_of_sdf_puts_it(tmp_path: Path) -> None:
    placements = write_house(tmp_path, num_models=7, num_placements=24, num_segments=3)
    world, imported = read_imported(tmp_path / "arena.world")
    assert imported.left_out == {}
    assert imported.num_items == len(world.items) == len(placements)
    scene = build_scene(world)
    names = [name.partition("/")[0] for name in scene.item_names]
    assert sorted(names) == sorted(placement.name for placement in placements)
    for placement in placements:
        corners = scene.corners[scene.item_index == names.index(placement.name)].reshape(-1, 3)
        gaps = np.linalg.norm(corners[:, None] - placement.vertices, axis=2)
        assert gaps.min(axis=1).max() < 1e-6
        assert gaps.min(axis=0).max() < 1e-6


def test_textures_of_a_house_are_held_once_each(tmp_path: Path) -> None:
    write_house(
        tmp_path,
        num_models=5,
        num_placements=17,
        num_segments=3,
        suffix=".dae",
        num_textures=8,
        texture_px=16,
    )
    world, imported = read_imported(tmp_path / "arena.world")
    assert imported.left_out == {}
    scene = build_scene(world)
    assert len(scene.textures) == len({id(image) for image in scene.textures}) == 8
    assert (np.bincount(scene.texture_index) > 0).all()


def assert_stands(item: Item, world_from_item: np.ndarray) -> None:  # type: ignore[type-arg] # (4, 4)
    points = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    expected = points @ world_from_item[:3, :3].T + world_from_item[:3, 3]
    found = item.world_from_item.transform_points(points @ SAE_FROM_SDF)
    np.testing.assert_allclose(found, expected @ SAE_FROM_SDF, atol=1e-8)


A, B, C, D = (
    "1 2 3 0.1 0.2 0.3", "-4 1 0.5 -0.4 0.3 2", "0 0 1 0 0 -1.5", "0.3 0.2 0.1 0.5 0 0"
)  # fmt: skip


@pytest.mark.parametrize(
    ("text", "chain"),
    [
        # A model relative to a frame that is relative to another.
        (
            f"<frame name='f'><pose relative_to='g'>{A}</pose></frame>"
            f"<frame name='g'><pose>{B}</pose></frame>"
            f"<model name='m'><pose relative_to='f'>{C}</pose>"
            f"<link name='l'><visual name='v'>{BOX}</visual></link></model>",
            (B, A, C),
        ),
        # A visual relative to a frame, not to its link.
        (
            f"<model name='m'><pose>{A}</pose><frame name='f' attached_to='k'><pose>{B}</pose>"
            f"</frame><link name='k'><pose>{D}</pose></link><link name='l'><pose>{C}</pose>"
            f"<visual name='v'><pose relative_to='f'>{C}</pose>{BOX}</visual></link></model>",
            (A, D, B, C),
        ),
        # A link relative to a joint, whose frame is that of its child.
        (
            f"<model name='m'><joint name='j' type='fixed'><parent>world</parent><child>k</child>"
            f"<pose>{A}</pose></joint><link name='k'><pose>{B}</pose></link><link name='l'>"
            f"<pose relative_to='j'>{C}</pose><visual name='v'>{BOX}</visual></link></model>",
            (B, A, C),
        ),
        # A model within a model, relative to a link of another one.
        (
            f"<model name='m'><model name='n'><pose>{A}</pose><link name='k'><pose>{B}</pose>"
            f"</link></model><model name='o'><pose relative_to='n::k'>{C}</pose>"
            f"<link name='l'><visual name='v'>{BOX}</visual></link></model></model>",
            (A, B, C),
        ),
        # Angles in degrees.
        (model(BOX, pose=f"1 0 0 0 0 {math.pi / 2}"), ("1 0 0 0 0 1.5707963267948966",)),
        (
            model(BOX).replace("<link", "<pose degrees='true'>1 0 0 90 0 -30</pose><link", 1),
            (f"1 0 0 {math.pi / 2} 0 {-math.pi / 6}",),
        ),
        # A quaternion of a quarter turn about z.
        (
            model(BOX).replace(
                "<link", "<pose rotation_format='quat_xyzw'>1 2 3 0 0 2 2</pose><link", 1
            ),
            (f"1 2 3 0 0 {math.pi / 2}",),
        ),
    ],
)
def test_pose_is_that_of_the_frames_of_sdf(
    tmp_path: Path, text: str, chain: tuple[str, ...]
) -> None:
    world, _ = import_text(tmp_path, text)
    assert_stands(world.items[0], np.linalg.multi_dot([np.eye(4), *map(matrix, chain)]))


def test_placement_frame_is_what_the_pose_of_a_model_places(tmp_path: Path) -> None:
    world, _ = import_text(
        tmp_path,
        f"<model name='m' placement_frame='l'><pose>{A}</pose><link name='l'><pose>{B}</pose>"
        f"<visual name='v'>{BOX}</visual></link></model>",
    )
    assert_stands(world.items[0], matrix(A))


def test_include_replaces_name_and_pose_of_its_model(tmp_path: Path) -> None:
    write_model(tmp_path, "chair_2", model(BOX, name="inside", pose=B))
    text = f"<uri>model://chair_2</uri><name>mine</name><pose>{A}</pose>"
    text = f"<include>{text}</include>" + "<include><uri>model://chair_2</uri></include>" * 2
    world, _ = import_text(tmp_path, text)
    assert [item.name for item in world.items] == ["mine", "inside", "inside_2"]
    assert {item.class_name for item in world.items} == {"chair"}
    assert_stands(world.items[0], matrix(A))
    assert_stands(world.items[1], matrix(B))


def write_model(folder: Path, name: str, text: str) -> Path:
    path = folder / "models" / name / "model.sdf"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<sdf version='1.6'>{text}</sdf>")
    return path


@pytest.mark.parametrize(
    ("geometry", "shapes"),
    [
        ("<box><size>1 2 3</size></box>", [Box((1.0, 2.0, 3.0))]),
        ("<cylinder><radius>1</radius><length>2</length></cylinder>", [Cylinder(1.0, 2.0)]),
        (
            "<sphere><radius>2</radius></sphere>",
            [SphereBand(2.0, 0.0, math.pi, 48, 24, is_solid=True)],
        ),
        ("<plane><normal>0 0 1</normal><size>4 5</size></plane>", [Rectangle((4.0, 5.0))]),
        (
            "<ellipsoid><radii>1 2 3</radii></ellipsoid>",
            [SphereBand(1.0, 0.0, math.pi, 48, 24, is_solid=True)],
        ),
    ],
)
def test_geometry_is_its_shape(tmp_path: Path, geometry: str, shapes: list[object]) -> None:
    world, _ = import_text(tmp_path, model(f"<geometry>{geometry}</geometry>"))
    assert [item.shape for item in world.items] == shapes
    assert world.items[0].name == world.items[0].class_name == "m"


def test_plane_faces_along_its_normal(tmp_path: Path) -> None:
    plane = "<geometry><plane><normal>0 -3 0</normal><size>4 5</size></plane></geometry>"
    scene = build_scene(import_text(tmp_path, model(plane))[0])
    np.testing.assert_allclose(scene.normals, [(0.0, 1.0, 0.0)] * 2, atol=1e-8)


def test_mesh_is_found_scaled_by_axis_and_relative_to_the_world_file(tmp_path: Path) -> None:
    path = write_model(tmp_path, "house", model(""))
    mesh = path.parent / "my mesh.stl"
    mesh.touch()
    uris = "model://house/my%20mesh.stl", "models/house/my mesh.stl"
    for uri in uris:
        text = f"<geometry><mesh><uri>{uri}</uri><scale>1 -2 0.5</scale></mesh></geometry>"
        world, _ = import_text(tmp_path, model(text))
        assert isinstance(world.items[0].shape, MeshFile)
        assert world.items[0].shape.path.resolve() == mesh
        assert world.items[0].scale == (1.0, -2.0, 0.5)
        assert world.items[0].material is None


@pytest.mark.parametrize(
    ("material", "colour", "unlit"),
    [
        ("<ambient>0 0 1 1</ambient><diffuse>1 0 0 1</diffuse>", (1.0, 0.0, 0.0), False),
        ("<ambient>0 0 1</ambient>", (0.0, 0.0, 1.0), False),
        ("<diffuse>0 0 0 1</diffuse><emissive>0 1 0 1</emissive>", (0.0, 1.0, 0.0), True),
        ("<diffuse>0 1 0 1</diffuse><lighting>false</lighting>", (0.0, 1.0, 0.0), True),
        ("<script><name>Gazebo/Red</name></script>", (1.0, 0.0, 0.0), False),
        ("<script><uri>a</uri><name> Gazebo/Turquoise </name></script>", (0.0, 1.0, 1.0), False),
        ("<script><name>Gazebo/YellowGlow</name></script>", (1.0, 1.0, 0.0), True),
        ("<script><name>Gazebo/LightOff</name></script>", (1.0, 0.0, 0.0), True),
        (
            "<script><name>Gazebo/Red</name></script><ambient>0 0 1</ambient>",
            (1.0, 0.0, 0.0),
            False,
        ),
        (
            "<script><name>Gazebo/Red</name></script><diffuse>0 0 1</diffuse>",
            (0.0, 0.0, 1.0),
            False,
        ),
        ("<script/><diffuse>0 0 1</diffuse><double_sided>0</double_sided>", (0.0, 0.0, 1.0), False),
    ],
)
def test_material_is_its_colour(
    tmp_path: Path, material: str, colour: tuple[float, ...], unlit: bool
) -> None:
    world, imported = import_text(tmp_path, model(f"{BOX}<material>{material}</material>"))
    assert imported.left_out == {}
    found = world.items[0].material
    assert found is not None
    assert (found.albedo, found.unlit) == (colour, unlit)


def test_texture_is_the_albedo_map(tmp_path: Path) -> None:
    (tmp_path / "brick.png").touch()
    pbr = "<pbr><metal><albedo_map>brick.png</albedo_map><roughness_map>r</roughness_map></metal>"
    text = f"{BOX}<cast_shadows>0</cast_shadows><material>{pbr}</pbr></material>"
    world, imported = import_text(tmp_path, model(text))
    assert world.items[0].material is not None
    assert world.items[0].material.texture == tmp_path / "brick.png"
    assert not world.items[0].casts_shadows
    assert imported.left_out == {"material/pbr/roughness_map": 1}


def test_lights_are_those_of_the_world_and_of_links(tmp_path: Path) -> None:
    lamp = (
        "<light name='b' type='point'><pose>0 0 1 0 0 0</pose><diffuse>1 1 1 1</diffuse>"
        "<attenuation><constant>1</constant><quadratic>0</quadratic></attenuation></light>"
    )
    text = (
        "<light name='a' type='directional'><pose>0 0 9 0 0 1.5707963267948966</pose>"
        "<direction>1 0 -1</direction><intensity>2</intensity></light>"
        f"<model name='m'><pose>{A}</pose><link name='l'>{lamp}</link></model>"
        "<scene><ambient>1 1 1 1</ambient><background>0 0 1 1</background></scene>"
    )
    world, imported = import_text(tmp_path, text + model(BOX))
    hemisphere, sun, point = world.lights
    assert hemisphere == HemisphereLight((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    assert isinstance(sun, DirectionalLight)
    np.testing.assert_allclose(sun.direction, np.array((0.0, -1.0, 1.0)) / math.sqrt(2), atol=1e-9)
    assert sun.irradiance == (2.0, 2.0, 2.0)
    assert isinstance(point, PointLight)
    expected = SAE_FROM_SDF @ (matrix(A) @ (0.0, 0.0, 1.0, 1.0))[:3]
    np.testing.assert_allclose(point.position_m, expected, atol=1e-8)
    assert point.intensity == (4.0, 4.0, 4.0)  # Gazebo's 1 at 2 m
    assert world.background == (0.0, 0.0, 1.0)
    assert list(imported.left_out) == [
        "light/attenuation other than by distance squared, as at 2 m"
    ]


def test_standard_models_need_no_folder(tmp_path: Path) -> None:
    text = "".join(
        f"<include><uri>model://{name}</uri></include>" for name in ("sun", "ground_plane", "tree")
    )
    world, imported = import_text(tmp_path, text)
    assert [item.shape for item in world.items] == [Rectangle((100.0, 100.0))]
    assert len(world.lights) == 2
    assert imported.left_out == {"include model://tree, which no folder has": 1}


def test_what_has_no_counterpart_is_counted(tmp_path: Path) -> None:
    visual = f"{BOX}<transparency>0.5</transparency>"
    more = "<plugin name='p' filename='f'/><static>true</static>"
    text = "<physics/><actor name='a'/><scene><sky/></scene>" + model(visual, more=more)
    text += model("<geometry><heightmap/></geometry>", name="n")
    _, imported = import_text(tmp_path, text)
    assert imported.left_out == {
        "world/physics": 1, "world/actor": 1, "scene/sky": 1, "model/plugin": 1,
        "visual/transparency, drawn opaque": 1, "geometry/heightmap": 1,
    }  # fmt: skip


def test_look_that_is_left_out_is_counted_by_name(tmp_path: Path) -> None:
    scripts = "".join(
        model(f"{BOX}<material><script><name>{name}</name></script></material>", name=f"m{i}")
        for i, name in enumerate(
            ("Gazebo/Bricks", "Gazebo/Bricks", "Red", "Gazebo/RedTransparent", "Glow", "")
        )
    )
    looks = "<transparency>{0}</transparency><material><double_sided>{0}</double_sided></material>"
    looks = model(BOX + looks.format(0)) + model(BOX + looks.format(1), name="n")
    lamps = "".join(
        f"<light name='l{value}' type='point'><cast_shadows>{value}</cast_shadows></light>"
        for value in (0, 1)
    )
    _, imported = import_text(tmp_path, scripts + looks + lamps)
    assert imported.left_out == {
        "material/script Gazebo/Bricks": 2, "material/script Red": 1, "material/script Glow": 1,
        "material/script Gazebo/RedTransparent": 1, "material/double_sided": 1,
        "visual/transparency, drawn opaque": 1, "light/cast_shadows of false: it casts them": 1,
    }  # fmt: skip


def nest(depth: int) -> str:
    return "<model name='m'>" * depth + "</model>" * depth


ENTITIES = "<!DOCTYPE sdf [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;&a;&a;'>]>"


@pytest.mark.parametrize(
    ("make_text", "message"),
    [
        (lambda _: ENTITIES + "<sdf version='1.6'>&b;</sdf>", "a file without a DTD"),
        (lambda _: "<a>" * 5000, "elements, 64 deep at most"),
        (lambda _: nest(30).join(("<sdf>", "</sdf>")), "models nested 16 deep at most"),
        (lambda _: "<sdf><model name='m'/>".ljust(3_000_000, " "), "XML of an SDF file"),
        (lambda _: f"<sdf><world>{nest(1) * 100_000}</world></sdf>", "at most 10000 models"),
        (lambda _: f"<sdf>{'<a/>' * 200_001}</sdf>", "at most 200000 elements,"),
        (lambda _: "<html/>", "<sdf>, as Gazebo's files begin"),
        (lambda _: "\0", "XML of an SDF file"),
        (lambda _: in_world("<include><uri>model://../../etc</uri></include>"), "inside of"),
        (lambda _: in_world("<include><uri>file:///etc</uri></include>"), "inside of"),
        (lambda _: in_world(mesh("../../etc/passwd")), "inside of the world's folder"),
        (lambda _: in_world(mesh("model://x/%2e%2e/../../etc/passwd")), "inside of"),
        (lambda _: in_world(mesh("a\0b")), "XML of an SDF file"),
        (lambda _: in_world(mesh("a%00b")), "a path"),
        (lambda _: in_world(mesh("model://link/secret.stl")), "inside of the world's folder"),
        (lambda _: in_world("<include><uri>model://loop</uri></include>"), "not include itself"),
        (lambda _: in_world(model(BOX, pose="nan 0 0 0 0 0")), "6 numbers of at most 100000"),
        (lambda _: in_world(model(BOX, pose="1e9 0 0 0 0 0")), "6 numbers of at most 100000"),
        (lambda _: in_world(model(BOX, pose="1 2 3")), "6 numbers"),
        (lambda _: in_world(model(BOX.replace("1 2 3", "0 1 1"))), "lengths above 0"),
        (lambda _: in_world(frame("f", "f")), "a chain of at most 64 frames without a cycle"),
        (lambda _: in_world(frame("f", "g") + frame("g", "f")), "without a cycle"),
        (lambda _: in_world(frame("wal", "f") + frame("f", "wall")), "did you mean wal"),
        (lambda _: in_world(model(BOX) * 9 + "</model>"), "arena.world:1:"),
    ],
)
def test_hostile_file_is_rejected_in_a_line(
    tmp_path: Path,
    make_text: Callable[[Path], str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "world"
    (folder / "models").mkdir(parents=True)
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "secret.stl").touch()
    (folder / "models" / "link").symlink_to(tmp_path / "outside")
    write_model(folder, "loop", model(BOX, more="<include><uri>model://pool</uri></include>"))
    write_model(folder, "pool", model(BOX, more="<include><uri>model://loop</uri></include>"))
    path = folder / "arena.world"
    path.write_text(make_text(tmp_path))
    out = tmp_path / "out.ini"
    words = ["import", str(path), "--models", str(folder / "models"), "--out", str(out)]
    assert main(words) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line
    assert len(line) < 400
    assert not out.exists()


def in_world(text: str) -> str:
    return f"<sdf version='1.9'><world name='w'>{text}</world></sdf>"


def mesh(uri: str) -> str:
    return model(f"<geometry><mesh><uri>{uri}</uri></mesh></geometry>")


def frame(name: str, relative_to: str) -> str:
    visual = f"<link name='l'><visual name='v'>{BOX}</visual></link>"
    return f"<model name='{name}'><pose relative_to='{relative_to}'/>{visual}</model>"


def test_includes_that_multiply_are_limited(tmp_path: Path) -> None:
    for level in range(15):
        include = f"<include><uri>model://m{level + 1}</uri></include>" * 4
        write_model(tmp_path, f"m{level}", model(BOX, name=f"m{level}", more=include))
    write_model(tmp_path, "m15", model(BOX))
    with pytest.raises(ConfigError, match=r"10000 models|nested 16 deep"):
        import_text(tmp_path, "<include><uri>model://m0</uri></include>")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--out", "arena.world"), "which ends with .ini, not arena.world"),
        (("--out", "a.ini", "--models", "nowhere"), "there is none of the name nowhere"),
    ],
)
def test_command_line_that_is_wrong_is_rejected(
    words: tuple[str, ...], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(["import", "arena.world", *words])
    assert end.value.code == 2
    assert message in capsys.readouterr().err


def test_world_of_gazebo_in_place_of_a_world_file_names_the_import(tmp_path: Path) -> None:
    (tmp_path / "arena.world").write_text(in_world(model(BOX)))
    with pytest.raises(ConfigError, match=r"`catoptra-server import .*arena.world --out FILE.ini`"):
        read_world(tmp_path / "arena.world")


def test_command_writes_the_world_and_lists_what_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arena.world"
    path.write_text(in_world(model(BOX) + "<physics/>"))
    out = tmp_path / "sub" / "arena.ini"
    out.parent.mkdir()
    assert main(["import", str(path), "--out", str(out)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{out}: 1 shapes, 1 lights, the start Start at -1.3, 0 m",
        "left out:",
        "      1 world/physics",
    ]
    assert read_world(out)[0].items[0].world_from_item.to_rpy() == Pose.identity().to_rpy()


def import_by_command(folder: Path, text: str) -> tuple[World, Path]:
    """World of the file that the command writes, and the file."""
    path = folder / "arena.world"
    path.write_text(in_world(text))
    out = folder / "arena.ini"
    assert main(["import", str(path), "--out", str(out)]) == 0
    world, file = read_world(out)
    assert file.unknown_names() == []
    return world, out


def test_start_is_not_in_a_box_without_a_floor_around_it(tmp_path: Path) -> None:
    (start,) = import_by_command(tmp_path, model(BOX) + model(BOX, name="n", pose="9 0 0 0 0 0"))[
        0
    ].starts
    assert 0.5 + 0.4 <= start.location_m[0] <= 8.5 - 0.4


@pytest.mark.parametrize("floor", ["", "<include><uri>model://ground_plane</uri></include>"])
def test_command_finds_a_start_where_a_robot_has_room(tmp_path: Path, floor: str) -> None:
    walls = "".join(
        model(BOX.replace("1 2 3", "0.2 6 3"), name=f"w{x}", pose=f"{x} 0 1.5 0 0 0")
        for x in (-3, 0, 3)
    )
    world, out = import_by_command(tmp_path, floor + walls)
    (start,) = world.starts
    assert 0.6 < abs(start.location_m[0]) < 2.4
    startup = read_startup_config([ROBOTS / "p2at_omni.ini"], out)
    assert startup.world.starts == (start,)


def test_world_that_cannot_be_loaded_has_no_start_and_says_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty.stl").touch()
    world, _ = import_by_command(tmp_path, mesh("empty.stl"))
    assert world.starts == ()
    assert "no start: " in (line := capsys.readouterr().out.splitlines()[0])
    assert "empty.stl" in line
