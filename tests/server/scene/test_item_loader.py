"""Items as triangles: poses, materials in place of a file's own, lights off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.world.scene_mesh import ItemLoader, ItemPart
from catoptra_server.world.shapes import facet_normals
from catoptra_server.world.world_description import Box, Item, Material, MeshFile
from helpers.mesh_file_samples import export_mesh, make_coloured_square, write_unlit_glb

WORLD_LINE = SourceLocation("house.ini", 12)
TURNED = Pose.from_rpy((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))


def load(item: Item) -> list[ItemPart]:
    return list(ItemLoader("w", MemoryBudget()).load_parts(7, item))


def make_item(path: Path, *, material: Material | None = None, unlit: bool | None = None) -> Item:
    return Item("it", MeshFile(path), Pose.identity(), material, unlit=unlit)


@pytest.mark.parametrize("pose", [Pose.identity(), Pose.from_rpy((1.0, 2.0, 3.0)), TURNED])
def test_mesh_file_is_transformed_by_the_pose_with_its_normals(tmp_path: Path, pose: Pose) -> None:
    path = export_mesh(make_coloured_square(), tmp_path / "m.ply")
    (part,) = load(Item("it", MeshFile(path), pose, None))
    (at_origin,) = load(make_item(path))
    np.testing.assert_allclose(part.corners, pose.transform_points(at_origin.corners), atol=1e-12)
    np.testing.assert_allclose(part.normals, facet_normals(part.corners)[0], atol=1e-12)
    assert part.item == 7


def test_shape_has_unit_normals_in_the_world() -> None:
    (part,) = load(Item("it", Box((1.0, 1.0, 1.0)), TURNED, Material((0.5, 0.5, 0.5))))
    outward = part.corners.mean(axis=1) - TURNED.translation
    assert (np.einsum("ni,ni->n", part.normals, outward) > 0.1).all()
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=-1), 1.0)


@pytest.mark.parametrize("unlit", [True, False])
def test_mesh_file_with_lights_off_keeps_its_colours(tmp_path: Path, unlit: bool) -> None:
    path = export_mesh(make_coloured_square(), tmp_path / "m.ply")
    (part,) = load(make_item(path, unlit=unlit))
    assert part.appearance.unlit is unlit
    np.testing.assert_array_equal(part.appearance.albedo, [[1.0, 0, 0], [1, 0, 0]])


@pytest.mark.parametrize(
    ("unlit", "expected"), [(None, [False, True]), (True, [True, True]), (False, [False, False])]
)
def test_item_overrides_what_a_file_says_of_lights(
    tmp_path: Path, unlit: bool | None, expected: list[bool]
) -> None:
    parts = load(make_item(write_unlit_glb(tmp_path), unlit=unlit))
    assert sorted(part.appearance.unlit for part in parts) == expected


def test_material_of_the_item_replaces_all_of_the_file(tmp_path: Path) -> None:
    grey = Material((0.5, 0.5, 0.5))
    parts = load(make_item(write_unlit_glb(tmp_path), material=grey))
    assert [part.appearance.unlit for part in parts] == [False, False]
    np.testing.assert_array_equal(np.concatenate([p.appearance.albedo for p in parts]), 0.5)


@pytest.mark.parametrize(
    ("name", "content", "key", "expected"),
    [
        (
            "cut.glb",
            b"glTF\x02\0\0\0\xff\0\0\0rest",
            "house.File",
            "cut off: 16 of 255 bytes",
        ),
        ("empty.glb", b"", "house.File", "it is empty"),
        ("points.obj", b"v 0 0 0\nv 1 0 0\n", "house.File", "at least one triangle"),
        ("part.step", b"ISO-10303", "house.File", "a known format"),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "house.File", "at least one tri"),
        (
            "bare.gltf",
            b'{"asset":{"version":"2.0"},"buffers":[{"uri":"none.bin","byteLength":12}]}',
            "house.File",
            "refers to none.bin, and there is no such file beside it",
        ),
    ],
)
def test_mesh_that_is_unusable_names_the_line_of_the_world(
    tmp_path: Path, name: str, content: bytes, key: str, expected: str
) -> None:
    (tmp_path / name).write_bytes(content)
    item = Item("house", MeshFile(tmp_path / name), Pose.identity(), None, where=WORLD_LINE)
    with pytest.raises(ConfigError) as caught:
        list(ItemLoader("world", MemoryBudget()).load_parts(0, item))
    assert (caught.value.location, caught.value.key) == (WORLD_LINE, key)
    assert expected in caught.value.expected
    assert str(tmp_path / name) in str(caught.value)


def test_texture_that_is_unusable_names_the_line_of_the_world(tmp_path: Path) -> None:
    image = tmp_path / "wall.png"
    image.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(40))
    material = Material((1.0, 1.0, 1.0), texture=image)
    item = Item("wall", Box((1.0, 1.0, 1.0)), Pose.identity(), material, where=WORLD_LINE)
    with pytest.raises(ConfigError) as caught:
        list(ItemLoader("world", MemoryBudget()).load_parts(0, item))
    assert (caught.value.location, caught.value.key) == (WORLD_LINE, "wall.Texture")
