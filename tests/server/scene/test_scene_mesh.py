"""From a world to one triangle soup: positions, appearance, items."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.runtime.memory import MIB, MemoryBudget
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    MeshFile,
    Rectangle,
    Ring,
    Shape,
    SphereBand,
    World,
)
from helpers.memory import peak_bytes
from helpers.mesh_file_samples import (
    export_mesh,
    make_coloured_square,
    make_plain_square,
    make_quadrant_image,
    make_textured_square,
)

GREY = Material((0.5, 0.5, 0.5))
BOX = Box((1.0, 1.0, 1.0))


def make_item(
    shape: Shape, material: Material | None = GREY, *, name: str = "it", x_m: float = 0.0
) -> Item:
    return Item(name, shape, Pose.from_rpy((x_m, 0.0, 0.0), (0.0, 0.0, 0.3)), material)


@pytest.mark.parametrize(
    ("shape", "triangles"),
    [
        (BOX, 12),
        (Cylinder(1.0, 1.0, sectors=10), 40),
        (Rectangle((1.0, 1.0)), 2),
        (Ring(0.5, 1.0, sectors=10), 20),
        (SphereBand(1.0, 0.0, 1.0, sectors=10, rings=2), 30),
    ],
)
def test_shape_has_its_triangles_with_unit_normals(shape: Shape, triangles: int) -> None:
    scene = build_scene(World("w", (make_item(shape),)))
    assert len(scene) == triangles
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=-1), 1.0, atol=1e-12)
    for array in (scene.uv, scene.albedo, scene.unlit, scene.texture_index, scene.item_index):
        assert len(array) == triangles


def test_empty_world_is_a_scene_without_triangles() -> None:
    scene = build_scene(World("w", ()))
    assert len(scene) == 0
    assert scene.corners.shape == (0, 3, 3)
    assert scene.normals.shape == (0, 3)


def test_items_are_transformed_by_their_poses() -> None:
    scene = build_scene(World("w", (make_item(BOX, x_m=5.0),)))
    np.testing.assert_allclose(scene.corners.mean(axis=(0, 1)), (5.0, 0.0, 0.0), atol=1e-12)
    ahead = scene.normals[np.argmax(scene.normals[:, 0])]
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(0.3)


def test_several_items_keep_their_indices() -> None:
    landmark = Landmark("b", "beacon", 1, 0, 0.1, 0.1, 0.2, 0.4, "cyan", "yellow")
    colours = {"cyan": (0.0, 1.0, 1.0), "yellow": (1.0, 1.0, 0.0)}
    items = (
        make_item(BOX, name="one"),
        make_item(BOX, Material((1.0, 0, 0), unlit=True), name="two"),
    )
    scene = build_scene(World("w", items, landmarks=(landmark,), landmark_albedos=colours))
    assert scene.item_names == ("one", "two", "b.post", "b.lower", "b.upper")
    second = scene.item_index == 1
    assert scene.unlit[second].all()
    assert not scene.unlit[~second].any()
    np.testing.assert_array_equal(
        np.unique(scene.albedo[scene.item_index == 3], axis=0), [[0, 1, 1]]
    )


def test_item_without_shadows_has_triangles_that_cast_none() -> None:
    glass = Item("glass", BOX, Pose.identity(), GREY, casts_shadows=False)
    mesh = build_scene(World("w", (make_item(BOX), glass)))
    assert mesh.casts_shadows.tolist() == [True] * 12 + [False] * 12


def test_scene_is_read_only() -> None:
    scene = build_scene(World("w", (make_item(BOX),)))
    with pytest.raises(ValueError, match="read-only"):
        scene.corners[0, 0, 0] = 1.0


# Textures.


def test_texture_of_an_item_is_on_its_triangles_only(tmp_path: Path) -> None:
    make_quadrant_image().save(tmp_path / "q.png")
    textured = Material((1.0, 1.0, 1.0), texture=tmp_path / "q.png")
    scene = build_scene(
        World("w", (make_item(BOX), make_item(BOX, textured), make_item(BOX, textured)))
    )
    # One file is one texture, however many items show it.
    assert scene.texture_index.tolist() == 12 * [-1] + 24 * [0]
    assert len(scene.textures) == 1
    assert scene.textures[0].shape == (2, 2, 3)
    assert scene.textures[0][0, 0].tolist() == [255, 0, 0]


@pytest.mark.parametrize(
    "shape",
    [SphereBand(1.0, 0.0, 1.0, sectors=4096, rings=4096), BOX],
    ids=["one large item", "many items"],
)
def test_scene_larger_than_the_memory_limit_is_rejected_before_it_is_built(shape: Shape) -> None:
    count = 1 if isinstance(shape, SphereBand) else 1000
    world = World("w", tuple(make_item(shape, name=f"item{n}") for n in range(count)))
    with pytest.raises(ConfigError, match=r"w: item\d+='\d+ triangles'.*fewer items.* MiB"):
        build_scene(world, MemoryBudget(4 * MIB if count > 1 else 1024 * MIB))


# Mesh files.


def test_mesh_without_a_material_keeps_its_own_appearance(tmp_path: Path) -> None:
    path = export_mesh(make_textured_square(pbr=True), tmp_path / "m.glb")
    scene = build_scene(World("w", (make_item(MeshFile(path), None),)))
    assert scene.texture_index.tolist() == [0, 0]
    np.testing.assert_array_equal(scene.albedo, 1.0)


def test_mesh_with_a_material_has_that_material(tmp_path: Path) -> None:
    path = export_mesh(make_textured_square(pbr=True), tmp_path / "m.glb")
    red = Material((1.0, 0.0, 0.0), unlit=True)
    scene = build_scene(World("w", (make_item(MeshFile(path), red),)))
    assert scene.texture_index.tolist() == [-1, -1]
    assert scene.unlit.all()
    np.testing.assert_array_equal(scene.albedo, [[1, 0, 0], [1, 0, 0]])


def test_mesh_is_transformed_by_its_pose(tmp_path: Path) -> None:
    path = export_mesh(make_plain_square(), tmp_path / "m.stl")
    scene = build_scene(World("w", (make_item(MeshFile(path), x_m=7.0),)))
    centre = 0.5 * (scene.corners.min(axis=(0, 1)) + scene.corners.max(axis=(0, 1)))
    np.testing.assert_allclose(centre, (7.0, 0.0, 0.0), atol=1e-6)  # STL keeps float32


# Colours that vary over a triangle.


def write_colourful_square(folder: Path) -> Path:
    """A square with a colour at each vertex, in the order red, green, blue, black."""
    mesh = make_plain_square()
    colours = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [0, 0, 0]]
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=colours)
    return export_mesh(mesh, folder / "colourful.ply")


def test_scene_of_plain_colours_has_no_corner_albedos(tmp_path: Path) -> None:
    path = export_mesh(make_coloured_square(), tmp_path / "m.ply")
    scene = build_scene(World("w", (make_item(BOX), make_item(MeshFile(path), None))))
    assert scene.corner_albedo is None


def test_corner_albedos_of_one_mesh_stand_beside_plain_triangles(tmp_path: Path) -> None:
    items = (make_item(BOX), make_item(MeshFile(write_colourful_square(tmp_path)), None))
    scene = build_scene(World("w", items))
    assert scene.corner_albedo is not None
    np.testing.assert_array_equal(scene.corner_albedo[:12], 0.5)
    np.testing.assert_array_equal(scene.corner_albedo[12], np.eye(3))
    np.testing.assert_allclose(scene.albedo, scene.corner_albedo.mean(axis=1))


# The box around all triangles.


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3])
def test_large_mesh_is_moved_to_its_position_without_a_copy(tmp_path: Path, yaw_rad: float) -> None:
    path = tmp_path / "sphere.ply"
    trimesh.creation.icosphere(subdivisions=6).export(path)
    pose = Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, yaw_rad))
    world = World("sphere", (Item("sphere", MeshFile(path), pose, GREY),))
    scene = build_scene(world)
    kept = scene.corners.nbytes + scene.normals.nbytes
    # 1.5: beside the triangles the file's own arrays and masks. With copies it was 2.2.
    assert peak_bytes(lambda: build_scene(world)) < 1.7 * kept


def test_box_of_a_scene_touches_its_extreme_corners() -> None:
    scene = build_scene(World("w", (make_item(BOX, x_m=5.0), make_item(BOX, x_m=-1.0))))
    np.testing.assert_array_equal(scene.box_min, scene.corners.min(axis=(0, 1)))
    np.testing.assert_array_equal(scene.box_max, scene.corners.max(axis=(0, 1)))


def test_box_of_an_empty_scene_is_inverted() -> None:
    scene = build_scene(World("w", ()))
    assert (scene.box_min > scene.box_max).all()


def test_objects_are_items_by_name_nodes_of_gltf_files_and_landmarks(tmp_path: Path) -> None:
    square = trimesh.creation.box((0.2, 0.3, 0.4))
    nodes = trimesh.Scene()
    nodes.add_geometry(square, node_name="chair.001", geom_name="a")
    nodes.add_geometry(square.copy(), node_name="desk", geom_name="b")
    path = tmp_path / "office.glb"
    path.write_bytes(nodes.export(file_type="glb"))
    landmark = Landmark("b", "beacon", 1, 0, 0.1, 0.1, 0.2, 0.4, "cyan", "yellow")
    colours = {"cyan": (0.0, 1.0, 1.0), "yellow": (1.0, 1.0, 0.0)}
    items = (
        make_item(BOX, name="table"),
        Item("office", MeshFile(path, up="y"), Pose.identity(), None),
        make_item(BOX, name="table"),
    )
    scene = build_scene(World("w", items, landmarks=(landmark,), landmark_albedos=colours))
    named = [(one.name, one.class_name) for one in scene.objects]
    assert (named[0], named[-1]) == (("table", "object"), ("b", "beacon"))
    # In the order in which trimesh walks the file.
    assert sorted(named[1:-1]) == [("office/chair.001", "chair"), ("office/desk", "desk")]
    counts = np.bincount(scene.object_index)
    assert counts[:3].tolist() == [24, 12, 12]
    assert (scene.object_index[scene.item_index == 0] == 0).all()
