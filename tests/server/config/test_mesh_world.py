"""A mesh file as a world: floor, light and start are found."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL.ImageFile import ImageFile

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.startup import read_startup_config
from catoptra_server.config.world_file import read_world
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import MeshFile, World
from helpers.configs import ROBOTS
from helpers.mesh_features import Gltf, pbr


def write_house(path: Path, *, floor_m: float = 0.0, furniture: bool = False) -> Path:
    """Write a house of 6 x 4 m with a flat roof, in the axes of its format."""
    parts = [((6.0, 4.0, 0.1), (0.0, 0.0, -0.05)), ((6.4, 4.4, 0.1), (0.0, 0.0, 2.55))]
    parts += [((0.2, 4.4, 2.5), (side * 3.1, 0.0, 1.25)) for side in (-1.0, 1.0)]
    parts += [((6.0, 0.2, 2.5), (0.0, side * 2.1, 1.25)) for side in (-1.0, 1.0)]
    if furniture:  # a table in the middle, and a chest that leaves the left half free
        parts += [((1.2, 0.8, 0.05), (0.0, 0.0, 0.75)), ((2.4, 4.0, 0.9), (1.7, 0.0, 0.45))]
    boxes = []
    for size, centre in parts:
        box = trimesh.creation.box(size)
        box.apply_translation(np.add(centre, (0.0, 0.0, floor_m)))
        boxes.append(box)
    mesh = trimesh.util.concatenate(boxes)
    if path.suffix == ".glb":  # x stays to the right, z up becomes y up
        mesh.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    mesh.export(path)
    return path


def read(path: Path) -> World:
    world, file = read_world(path)
    assert file.unknown_names() == []
    return world


@pytest.mark.parametrize("suffix", [".glb", ".stl", ".ply", ".obj"])
@pytest.mark.parametrize("floor_m", [0.0, 1.25, -3.0])
def test_mesh_file_is_a_world_on_its_floor(tmp_path: Path, suffix: str, floor_m: float) -> None:
    path = write_house(tmp_path / f"house{suffix}", floor_m=floor_m)
    world = read(path)
    assert world.name == "house"
    assert isinstance(world.items[0].shape, MeshFile)
    assert world.lights
    scene = build_scene(world)
    np.testing.assert_allclose((scene.box_min[2], scene.box_max[2]), (-2.6, 0.1), atol=1e-3)
    (start,) = world.starts
    np.testing.assert_allclose(start.location_m, (0.0, 0.0, 0.0), atol=0.02)


def test_start_is_on_free_floor_beside_furniture(tmp_path: Path) -> None:
    (start,) = read(write_house(tmp_path / "house.stl", furniture=True)).starts
    # Between the wall at -3 m and the table at -0.6 m.
    assert -3.0 + 0.4 <= start.location_m[0] <= -0.6 - 0.4
    startup = read_startup_config([ROBOTS / "p2at_omni.ini"], tmp_path / "house.stl")
    assert startup.world.starts == (start,)


def test_what_was_found_is_stated(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = write_house(tmp_path / "house.glb", floor_m=0.5)
    with caplog.at_level(logging.INFO):
        read(path)
    text = "\n".join(caplog.messages)
    assert "house.glb as a world: in metres, y up; 4.40 x 6.40 m, 2.70 m high" in text
    assert "the floor is at 0.5 m of the file's height; light of a day is added" in text
    assert "the start is Start, at " in text
    assert "is it in metres?" not in text


def test_mesh_file_of_another_unit_is_asked_for(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write_house(tmp_path / "house.stl")
    mesh = trimesh.load_mesh(path)
    mesh.apply_scale(1000.0)
    mesh.export(path)
    with caplog.at_level(logging.INFO):
        read(path)
    assert "is it in metres?" in "\n".join(caplog.messages)


def test_mesh_file_without_free_floor_has_no_start(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "tile.stl"
    trimesh.creation.box((0.3, 0.3, 0.02)).export(path)
    with caplog.at_level(logging.INFO):
        assert read(path).starts == ()
    assert "no free floor for a start: give a Location" in "\n".join(caplog.messages)


@pytest.mark.parametrize("size_m", [(0.2, 0.2, 3.0), (0.6, 2.0, 1.0), (0.1, 0.1, 0.1)])
def test_thing_stands_on_the_ground_and_the_start_is_beside_it(
    tmp_path: Path, size_m: tuple[float, float, float]
) -> None:
    path = tmp_path / "thing.stl"
    trimesh.creation.box(size_m).export(path)
    world = read(path)
    assert build_scene(world).box_max[2] == pytest.approx(0.0, abs=1e-6)
    (start,) = world.starts
    x, y = np.abs(start.location_m[:2])
    assert x > 0.5 * size_m[0] + 0.35 or y > 0.5 * size_m[1] + 0.35


@pytest.mark.parametrize("name", ["none.glb", 'a"b.stl'])
def test_mesh_file_that_cannot_be_a_world_is_rejected(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError):
        read_world(tmp_path / name)


def test_images_of_a_mesh_file_are_decoded_and_its_losses_reported_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = Gltf(**pbr(texture=0, normalTexture={"index": 0})).texture().write(tmp_path)
    loaded, load = [], ImageFile.load

    def count(image: ImageFile) -> object:
        loaded.append(image)
        return load(image)

    monkeypatch.setattr(ImageFile, "load", count)
    world = read(path)
    assert loaded == []
    (texture,) = build_scene(world).textures
    assert len({id(image) for image in loaded}) == 1
    assert texture.shape == (*loaded[0].size[::-1], 3)
    assert caplog.text.count("normal map") == 1
