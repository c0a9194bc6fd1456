"""From a world to one triangle soup: positions, appearance, items, landmarks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.runtime.memory import (
    BYTES_PER_TEXEL,
    BYTES_PER_TRIANGLE,
    MIB,
    MemoryBudget,
)
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shapes import facet_normals
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
    write_textured_dae,
    write_textured_gltf,
    write_unlit_glb,
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


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    "shape", [BOX, Cylinder(0.5, 1.0), SphereBand(0.5, 0.0, np.pi, 96, 48, is_solid=True)]
)
def test_shape_is_scaled_along_its_axes_and_stays_lit_from_outside(
    shape: Shape, sign: float
) -> None:
    item = replace(make_item(shape), world_from_item=Pose.identity(), scale=(2.0, sign * 3.0, 0.5))
    scene = build_scene(World("w", (item,)))
    extent = scene.box_max - scene.box_min
    np.testing.assert_allclose(extent, (2.0, 3.0, 0.5), atol=0.01)
    centres = scene.corners.mean(axis=1)
    assert (np.einsum("ij,ij->i", scene.normals, centres) > 0.0).all()


def test_mesh_file_that_is_mirrored_keeps_its_front_and_its_texture(tmp_path: Path) -> None:
    square = make_textured_square()
    path = export_mesh(square, tmp_path / "square.glb")
    item = Item("s", MeshFile(path), Pose.identity(), None)
    plain, mirrored = (
        build_scene(World("w", (replace(item, scale=scale),)))
        for scale in ((1.0, 1.0, 1.0), (1.0, -1.0, 1.0))
    )
    np.testing.assert_allclose(mirrored.normals, plain.normals * (1.0, -1.0, 1.0), atol=1e-12)
    # Each corner has the texture coordinates of the corner that it mirrors.
    np.testing.assert_array_equal(mirrored.corners[:, ::-1], plain.corners * (1.0, -1.0, 1.0))
    np.testing.assert_array_equal(mirrored.uv[:, ::-1], plain.uv)


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


def place_often(shape: MeshFile, count: int, *, yaw_rad: float = 0.3) -> World:
    """A world of one mesh file at places along x."""
    poses = (Pose.from_rpy((n, 0.0, 0.0), (0.0, 0.0, n * yaw_rad)) for n in range(count))
    return World("w", tuple(Item(f"i{n}", shape, pose, None) for n, pose in enumerate(poses)))


@pytest.mark.parametrize("yaw_rad", [0.0, 0.3])
@pytest.mark.parametrize("write", [write_textured_gltf, write_textured_dae])
def test_file_of_many_placements_is_read_once_and_its_texture_held_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    write: Callable[[Path], Path],
    yaw_rad: float,
) -> None:
    shape = MeshFile(write(tmp_path))
    world = place_often(shape, 113, yaw_rad=yaw_rad)
    alone = [build_scene(replace(world, items=(item,))) for item in world.items[:: 112 // 4]]
    reads: Counter[str] = Counter()
    read = Path.read_bytes
    monkeypatch.setattr(
        Path, "read_bytes", lambda path: (reads.update((path.name,)), read(path))[1]
    )
    scene = build_scene(world)
    assert set(reads.values()) == {1}
    assert len(scene.textures) == 1
    assert scene.albedo.strides[0] == 0  # one row for all
    assert len(scene.uv) == len(alone[0])
    # Every placement is what it would be alone, to the last bit.
    for number, one in zip(range(0, 113, 112 // 4), alone, strict=True):
        rows = scene.item_index == number
        for name in ("corners", "normals", "corner_uv", "albedo"):
            np.testing.assert_array_equal(getattr(scene, name)[rows], getattr(one, name))


def test_placements_count_their_triangles_each_and_their_texture_once(tmp_path: Path) -> None:
    world = place_often(MeshFile(write_textured_gltf(tmp_path)), 113)
    needed = 113 * 2 * BYTES_PER_TRIANGLE + BYTES_PER_TEXEL * 2 * 2
    build_scene(world, MemoryBudget(needed))
    with pytest.raises(ConfigError, match=r"of 2 triangles'.*fewer triangles"):
        build_scene(world, MemoryBudget(needed - 1))


def test_equal_images_of_different_files_and_items_are_one_texture(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        make_quadrant_image().save(tmp_path / name)
    walls = [Material((1.0, 1.0, 1.0), texture=tmp_path / name) for name in ("a.png", "b.png")]
    scene = build_scene(World("w", tuple(make_item(BOX, wall) for wall in walls)))
    assert len(scene.textures) == 1
    assert (scene.texture_index == 0).all()


def test_damaged_texture_is_reported_with_the_line_of_its_item(tmp_path: Path) -> None:
    make_quadrant_image().resize((64, 64)).save(tmp_path / "q.png")
    (tmp_path / "q.png").write_bytes((tmp_path / "q.png").read_bytes()[:60])
    wall = replace(
        make_item(BOX, Material((1.0, 1.0, 1.0), texture=tmp_path / "q.png"), name="wall"),
        where=SourceLocation("w.ini", 7),
    )
    with pytest.raises(ConfigError, match=r"w\.ini:7: wall\.Texture='.*q\.png': .*an image file"):
        build_scene(World("w", (make_item(BOX), wall)))


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
    # Everywhere on the sphere, however many blocks the triangles are.
    np.testing.assert_allclose(np.linalg.norm(scene.corners - (1.0, 2.0, 3.0), axis=-1), 1.0)


def test_hierarchy_of_a_scene_is_made_once() -> None:
    scene = build_scene(World("w", (make_item(BOX),)))
    assert scene.hierarchy() is scene.hierarchy()


def test_box_of_a_scene_touches_its_extreme_corners() -> None:
    scene = build_scene(World("w", (make_item(BOX, x_m=5.0), make_item(BOX, x_m=-1.0))))
    np.testing.assert_array_equal(scene.box_min, scene.corners.min(axis=(0, 1)))
    np.testing.assert_array_equal(scene.box_max, scene.corners.max(axis=(0, 1)))
    np.testing.assert_array_equal(scene.centre, 0.5 * (scene.box_min + scene.box_max))


def test_box_of_an_empty_scene_is_inverted() -> None:
    scene = build_scene(World("w", ()))
    assert (scene.box_min > scene.box_max).all()
    assert scene.centre.tolist() == [0.0, 0.0, 0.0]


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


ALBEDOS = {"cyan": (0.0, 0.4, 0.7), "magenta": (0.8, 0.0, 0.3), "yellow": (0.9, 0.7, 0.0)}
BEACON = Landmark("b", "beacon", 1.35, -1.9, 0.1, 0.1, 0.2, 0.4, "yellow", "magenta")
GOAL = Landmark("g", "goal", 2.7, 0.1, 0.8, 0.3, 0.0, 0.3, "cyan", "cyan")
OTHER_GOAL = Landmark("g", "goal", -2.7, 0.1, 0.8, 0.3, 0.0, 0.3, "cyan", "cyan")


def build_landmark(landmark: Landmark) -> SceneMesh:
    return build_scene(World("w", (), landmarks=(landmark,), landmark_albedos=ALBEDOS))


def bounds(scene: SceneMesh, part: str) -> tuple[Floats, Floats]:
    """Lower and upper (x, y, height) of an item."""
    index = scene.item_names.index(part)
    corners = scene.corners[scene.item_index == index] * (1.0, 1.0, -1.0)
    return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


@pytest.mark.parametrize(
    ("part", "bottom", "top", "albedo"),
    [
        ("b.post", 0.0, 0.2, (0.8, 0.8, 0.8)),
        ("b.lower", 0.2, 0.3, ALBEDOS["yellow"]),
        ("b.upper", 0.3, 0.4, ALBEDOS["magenta"]),
    ],
)
def test_beacon_has_its_bands_at_the_documented_heights(
    part: str, bottom: float, top: float, albedo: tuple[float, float, float]
) -> None:
    scene = build_landmark(BEACON)
    lower, upper = bounds(scene, part)
    np.testing.assert_allclose(lower, (1.3, -1.95, bottom), atol=1e-9)
    np.testing.assert_allclose(upper, (1.4, -1.85, top), atol=1e-9)
    own = scene.item_index == scene.item_names.index(part)
    assert own.sum() == len(build_scene(World("w", (make_item(Cylinder(1.0, 1.0)),))))
    np.testing.assert_array_equal(np.unique(scene.albedo[own], axis=0), [albedo])


def test_beacon_with_a_band_at_the_floor_has_no_post() -> None:
    low = Landmark("b", "beacon", 0, 0, 0.1, 0.1, 0.0, 0.4, "cyan", "cyan")
    assert build_landmark(low).item_names == ("b.lower", "b.upper")


@pytest.mark.parametrize(("goal", "outward"), [(GOAL, 1.0), (OTHER_GOAL, -1.0)])
def test_goal_is_open_towards_the_origin(goal: Landmark, outward: float) -> None:
    scene = build_landmark(goal)
    xs = outward * scene.corners[..., 0]
    # From the mouth on the goal line to the back board, 0.3 m behind and 0.02 m thick.
    assert (xs.min(), xs.max()) == pytest.approx((2.7, 3.02))
    lower, upper = bounds(scene, "g.back")
    assert min(abs(lower[0]), abs(upper[0])) == pytest.approx(3.0)


def test_goal_has_its_mouth_between_the_side_boards() -> None:
    scene = build_landmark(GOAL)
    _, left = bounds(scene, "g.left")
    right, _ = bounds(scene, "g.right")
    assert (left[1], right[1]) == pytest.approx((0.1 - 0.4, 0.1 + 0.4))
    assert (scene.corners[..., 2].min(), scene.corners[..., 2].max()) == pytest.approx((-0.3, 0.0))


def test_goal_has_its_colour() -> None:
    np.testing.assert_array_equal(np.unique(build_landmark(GOAL).albedo, axis=0), [ALBEDOS["cyan"]])


TURNED = Pose.from_rpy((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))


def load_mesh(
    path: Path,
    *,
    pose: Pose | None = None,
    material: Material | None = None,
    unlit: bool | None = None,
) -> SceneMesh:
    """Scene of one mesh file."""
    item = Item("it", MeshFile(path), pose or Pose.identity(), material, unlit=unlit)
    return build_scene(World("w", (item,)))


@pytest.mark.parametrize("pose", [Pose.identity(), Pose.from_rpy((1.0, 2.0, 3.0)), TURNED])
def test_mesh_file_is_transformed_by_the_pose_with_its_normals(tmp_path: Path, pose: Pose) -> None:
    path = export_mesh(make_coloured_square(), tmp_path / "m.ply")
    placed, at_origin = load_mesh(path, pose=pose), load_mesh(path)
    expected = pose.transform_points(at_origin.corners)
    np.testing.assert_allclose(placed.corners, expected, atol=1e-12)
    np.testing.assert_allclose(placed.normals, facet_normals(placed.corners)[0], atol=1e-12)


@pytest.mark.parametrize("unlit", [True, False])
def test_mesh_file_with_lights_off_keeps_its_colours(tmp_path: Path, unlit: bool) -> None:
    path = export_mesh(make_coloured_square(), tmp_path / "m.ply")
    scene = load_mesh(path, unlit=unlit)
    assert scene.unlit.tolist() == [unlit] * 2
    np.testing.assert_array_equal(scene.albedo, [[1.0, 0, 0], [1, 0, 0]])


@pytest.mark.parametrize(
    ("unlit", "expected"), [(None, [False, True]), (True, [True, True]), (False, [False, False])]
)
def test_item_overrides_what_a_file_says_of_lights(
    tmp_path: Path, unlit: bool | None, expected: list[bool]
) -> None:
    scene = load_mesh(write_unlit_glb(tmp_path), unlit=unlit)
    of_objects = [scene.unlit[scene.object_index == number] for number in range(2)]
    assert sorted(bool(unlit.all()) for unlit in of_objects) == expected
    assert all(unlit.all() == unlit.any() for unlit in of_objects)


def test_material_of_the_item_replaces_all_of_the_file(tmp_path: Path) -> None:
    scene = load_mesh(write_unlit_glb(tmp_path), material=GREY)
    assert not scene.unlit.any()
    np.testing.assert_array_equal(scene.albedo, 0.5)


def test_normals_that_differ_from_facets_by_rounding_bend_nothing() -> None:
    scene = build_scene(World("box", (make_item(BOX),)))
    normals = np.repeat(scene.normals[:, None], 3, axis=1)
    turned = [normals + change for change in (1e-15, 1e-3)]
    bent = [replace(scene, corner_normals=one).bent for one in turned]
    assert [one is not None and one.any() for one in bent] == [False, True]
