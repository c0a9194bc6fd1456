"""Scenes, objects, lights and textures as the kernel's arrays; flat surfaces and spheres."""

from __future__ import annotations

import ctypes
import gc
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel import scene_arrays as texture_arrays
from catoptra_server.render.trace.kernel.kernel_structs import (
    FACET_CORNER_COLOURS,
    FACET_TEXTURED,
    FACET_UNLIT,
    LIGHT_DIRECTIONAL,
    LIGHT_POINT,
    SAMPLE_CLAMP_U,
    TextureStruct,
)
from catoptra_server.render.trace.kernel.library import (
    KernelDevice,
    available_instruction_sets,
    choose_instruction_set,
)
from catoptra_server.render.trace.kernel.scene_arrays import (
    FlatSurfaces,
    OwningStruct,
    caster_arrays,
    corner_arrays,
    encoded_table,
    find_flat_surfaces,
    hemisphere_struct,
    light_array,
    object_arrays,
    radiance_table,
    scene_arrays,
    surfaces_struct,
    texture_array,
)
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.shading import facet_radiance, light_of_bytes
from catoptra_server.world.textures import REPEATED, TextureReader, TextureSampling
from catoptra_server.world.triangles import ROWS_PER_BLOCK
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    Ring,
    Shape,
    SphereBand,
    World,
    linear_from_srgb,
)
from helpers.dynamic_objects import ROBOT_MESH
from helpers.memory import peak_bytes
from helpers.worlds import (
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_test_world,
    write_smooth_texture,
)

FAR = np.array((20e3, -15e3, 300.0))


def read_array(
    address: int, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float32
) -> npt.NDArray[Any]:
    """Copy of an array at an address."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.frombuffer(ctypes.string_at(address, size), dtype=dtype).reshape(shape)


@pytest.fixture
def textured(tmp_path: Path) -> SceneMesh:
    """A scene with one textured floor and plain items."""
    return build_scene(make_test_world(texture=write_smooth_texture(tmp_path / "waves.png")))


def test_scene_s_arrays_are_relative_to_its_centre() -> None:
    near = build_scene(make_test_world())
    far = replace(near, corners=near.corners + FAR)
    owned = scene_arrays(far, FAR)
    arrays = owned.struct
    count = len(near)
    assert arrays.num_triangles == count
    # Subtracted in float64: at 20 km float32 alone would round to 2 mm.
    corners = read_array(arrays.corners, (count, 3, 3))
    np.testing.assert_allclose(corners, near.corners, atol=1e-6)
    np.testing.assert_allclose(read_array(arrays.normals, (count, 3)), near.normals, atol=1e-7)
    np.testing.assert_allclose(read_array(arrays.albedo, (count, 3)), near.albedo, atol=1e-7)


def test_scene_s_flags_name_unlit_textured_and_coloured_triangles(textured: SceneMesh) -> None:
    colours = np.repeat(textured.albedo[:, None], 3, axis=1)
    colours[5, 1] += 0.1
    scene = replace(textured, corner_albedo=colours)
    owned = scene_arrays(scene, np.zeros(3))
    arrays = owned.struct
    flags = read_array(arrays.flags, (len(scene),), np.uint8)
    np.testing.assert_array_equal((flags & FACET_UNLIT) > 0, scene.unlit)
    np.testing.assert_array_equal((flags & FACET_TEXTURED) > 0, scene.texture_index >= 0)
    assert np.flatnonzero(flags & FACET_CORNER_COLOURS).tolist() == [5]
    found = read_array(arrays.corner_albedo, (len(scene), 3, 3))
    np.testing.assert_allclose(found, colours, atol=1e-7)


def test_corners_of_more_than_a_block_are_relative_to_the_centre() -> None:
    corners = np.random.default_rng(6).uniform(90.0, 110.0, (ROWS_PER_BLOCK + 5, 3, 3))
    centre = np.array([100.0, 99.0, 101.0])
    relative = corner_arrays(corners, centre).owners[0]
    np.testing.assert_array_equal(relative, (corners - centre).astype(np.float32))


def test_scene_s_texture_coordinates_are_read_where_the_scene_holds_them(
    textured: SceneMesh,
) -> None:
    owned = scene_arrays(textured, np.zeros(3))
    arrays = owned.struct
    assert arrays.uv == textured.uv.ctypes.data
    index = read_array(arrays.texture, (len(textured),), np.int32)
    np.testing.assert_array_equal(index, textured.texture_index)


def test_scene_when_plain_has_no_optional_arrays() -> None:
    owned = scene_arrays(build_scene(make_test_world()), np.zeros(3))
    arrays = owned.struct
    assert (arrays.uv, arrays.texture, arrays.corner_albedo) == (None, None, None)


def test_scene_when_empty_has_no_triangles() -> None:
    assert scene_arrays(build_scene(World("w", ())), np.zeros(3)).struct.num_triangles == 0


def test_arrays_live_as_long_as_their_owner(textured: SceneMesh) -> None:
    owned = scene_arrays(textured, np.zeros(3))
    before = read_array(owned.struct.uv, (len(textured), 6))
    gc.collect()
    scene_arrays(textured, np.ones(3))
    np.testing.assert_array_equal(read_array(owned.struct.uv, (len(textured), 6)), before)


def test_object_s_arrays_are_in_its_own_frame() -> None:
    owned = object_arrays(ROBOT_MESH)
    arrays = owned.struct
    shape = (len(ROBOT_MESH), 3, 3)
    np.testing.assert_allclose(read_array(arrays.corners, shape), ROBOT_MESH.corners, atol=1e-7)
    flags = read_array(arrays.flags, shape[:1], np.uint8)
    np.testing.assert_array_equal(flags, ROBOT_MESH.unlit * FACET_UNLIT)


def test_casters_are_the_triangles_that_occlude() -> None:
    world = make_test_world()
    glass = replace(world.items[2], casts_shadows=False)
    scene = build_scene(replace(world, items=(*world.items[:2], glass, *world.items[3:])))
    owned = caster_arrays(scene, np.ones(3))
    arrays = owned.struct
    kept = scene.corners[scene.item_index != 2] - 1.0
    assert arrays.num_triangles == len(kept) == len(scene) - 12
    np.testing.assert_allclose(read_array(arrays.corners, kept.shape), kept, atol=1e-6)


def test_textures_have_their_size_without_border(textured: SceneMesh) -> None:
    images = (textured.textures[0], textured.textures[0][:3, :5])
    wide = replace(textured, textures=images, samplings=2 * textured.samplings)
    owned = texture_array(wide)
    second = owned.owners[1]
    assert isinstance(second, OwningStruct)
    assert [struct.num_levels for struct in owned.struct] == [7, 3]
    assert owned.struct[1].levels == ctypes.addressof(second.struct)
    sizes = [(level.width, level.height) for level in second.struct]
    assert sizes == [(5, 3), (2, 1), (1, 1)]
    # With a border each; the image as the light of its bytes.
    image = read_array(second.struct[0].texels, (5, 7, 3), np.uint16)
    light = np.rint(65535 * light_of_bytes())[images[1]]
    np.testing.assert_array_equal(image[1:-1, 1:-1], light)
    np.testing.assert_array_equal(image[0, 1:-1], light[-1])
    np.testing.assert_array_equal(
        read_array(second.struct[1].texels, (3, 4, 3), np.uint16), second.owners[1]
    )


# Six bytes a texel of a small scene, three of a large one; two of coarser levels; borders.
@pytest.mark.parametrize(("is_large", "max_bytes_per_texel"), [(False, 8.9), (True, 5.6)])
def test_image_is_held_once_for_all_its_samplings(
    textured: SceneMesh,
    monkeypatch: pytest.MonkeyPatch,
    is_large: bool,
    max_bytes_per_texel: float,
) -> None:
    image = textured.textures[0]
    num_texels = image.shape[0] * image.shape[1]
    monkeypatch.setattr(texture_arrays, "MAX_LIGHT_TEXELS", num_texels - is_large)
    samplings = (REPEATED, TextureSampling(clamps_u=True))
    owned = texture_array(replace(textured, textures=(image, image), samplings=samplings))
    first, second = owned.struct
    assert first.levels == second.levels
    assert (first.sampling, second.sampling) == (0, SAMPLE_CLAMP_U)
    levels = owned.owners[0]
    assert isinstance(levels, OwningStruct)
    held = sum(one.nbytes for one in levels.owners if isinstance(one, np.ndarray))
    assert held < max_bytes_per_texel * num_texels


@pytest.mark.parametrize("channels", [3, 4])
def test_large_scenes_images_are_those_that_were_read(
    textured: SceneMesh, monkeypatch: pytest.MonkeyPatch, channels: int
) -> None:
    pixels = np.random.default_rng(5).integers(0, 256, (6, 5, channels), dtype=np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    with TextureReader() as reader:
        image = reader.decode(file.getvalue(), SourceLocation("x"), has_opacity=channels == 4)
        reader.wait(image)
    monkeypatch.setattr(texture_arrays, "MAX_LIGHT_TEXELS", 0)
    levels = texture_array(replace(textured, textures=(image,))).owners[0]
    assert isinstance(levels, OwningStruct)
    texels = levels.owners[0]
    assert isinstance(texels, np.ndarray)
    assert np.shares_memory(texels, image)
    np.testing.assert_array_equal(texels, np.pad(pixels, ((1, 1), (1, 1), (0, 0)), mode="wrap"))


def test_rays_of_sensors_have_the_images_alone(textured: SceneMesh) -> None:
    owned = texture_array(textured, lambda image: (image,))
    levels = owned.owners[0]
    assert isinstance(levels, OwningStruct)
    assert owned.struct[0].num_levels == len(levels.owners) == 1


def test_textures_when_there_are_none_are_one_empty_place() -> None:
    owned = texture_array(build_scene(make_test_world()))
    assert len(owned.struct) == 1
    assert isinstance(owned.struct[0], TextureStruct)
    assert owned.struct[0].levels is None


def test_lights_are_those_that_can_be_occluded_directional_ones_first() -> None:
    lights = (POINT_LIGHT, HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
    structs, count = light_array(lights, (POINT_LIGHT,), np.array((1.0, 2.0, 3.0)))
    assert count == len(structs) == 2
    directional, point = structs
    assert (directional.kind, directional.lights_scene) == (LIGHT_DIRECTIONAL, 0)
    assert tuple(directional.vector) == pytest.approx([-x for x in DIRECTIONAL_LIGHT.direction])
    assert (point.kind, point.lights_scene) == (LIGHT_POINT, 1)
    assert tuple(point.vector) == pytest.approx((0.4 - 1.0, -0.5 - 2.0, -1.4 - 3.0))
    assert tuple(point.intensity) == pytest.approx(POINT_LIGHT.intensity)


def test_lights_when_there_are_none_count_nothing() -> None:
    assert light_array((HEMISPHERE_LIGHT,), (HEMISPHERE_LIGHT,), np.zeros(3))[1] == 0


def test_hemisphere_is_the_sum_of_all() -> None:
    other = HemisphereLight((0.1, 0.2, 0.3), (0.4, 0.5, 0.6))
    found = hemisphere_struct((HEMISPHERE_LIGHT, POINT_LIGHT, other))
    assert tuple(found.up) == pytest.approx((0.8, 0.9, 1.0))
    assert tuple(found.down) == pytest.approx((0.7, 0.8, 0.9))
    assert tuple(hemisphere_struct(()).up) == (0.0, 0.0, 0.0)


def test_surfaces_name_triangles_edges_and_representatives() -> None:
    scene = build_scene(
        World("w", (Item("box", Box((1, 2, 3)), Pose.identity(), Material((0.5, 0.5, 0.5))),))
    )
    owned = surfaces_struct(find_surfaces(scene))
    struct = owned.struct
    assert struct.num_surfaces == 6
    surface = read_array(struct.surface, (12,), np.int32)
    representative = read_array(struct.representative, (6,), np.int32)
    np.testing.assert_array_equal(surface[representative], np.arange(6))
    edges = read_array(struct.outer_edges, (12,), np.uint8)
    assert [int(mask).bit_count() for mask in edges] == [2] * 12


def test_radiance_of_facets_is_that_of_the_shading_model_and_ends_with_the_background() -> None:
    scene = build_scene(make_test_world())
    lights = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
    table = radiance_table(scene, lights, (0.1, 0.2, 0.3))
    np.testing.assert_allclose(table[:-1], facet_radiance(scene, lights), rtol=1e-6)
    np.testing.assert_allclose(table[-1], (0.1, 0.2, 0.3), rtol=1e-6)
    assert table.dtype == np.float32


def test_tables_of_many_facets_take_little_memory_beside_themselves() -> None:
    ring = Item("ring", Ring(0.5, 1.0, sectors=150_000), Pose.identity(), Material((0.5, 0.5, 0.5)))
    scene = build_scene(World("w", (ring,)))
    lights = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
    encoded_table(np.zeros((1, 3), dtype=np.float32))  # the table of greys is made once
    peak = peak_bytes(lambda: encoded_table(radiance_table(scene, lights, (0.1, 0.2, 0.3))))
    # 12 and 4 bytes a facet, and blocks; float64 in between took 48 more.
    assert peak < 32 * len(scene)


def test_encoded_radiance_has_red_in_the_lowest_byte_and_is_clipped() -> None:
    radiance = np.array([(1.0, 0.0, 0.2158605), (7.0, -1.0, 0.0)], dtype=np.float32)
    assert encoded_table(radiance).tolist() == [0x8000FF, 0x0000FF]


def test_encoded_radiance_when_no_number_is_black() -> None:
    radiance = np.array([(np.nan, np.inf, -np.inf)], dtype=np.float32)
    assert encoded_table(radiance).tolist() == [0x00FF00]


RNG = np.random.default_rng(3)


@pytest.mark.parametrize("shape", [(5, 7), (1, 1), (1, 4), (6, 1), (2, 2)])
def test_coarser_texels_are_linear_light_and_their_border_repeats_the_opposite_side(
    textured: SceneMesh, shape: tuple[int, int]
) -> None:
    image = RNG.integers(0, 256, (2 * shape[0], 2 * shape[1], 3), dtype=np.uint8)
    levels = texture_array(replace(textured, textures=(image,))).owners[0]
    assert isinstance(levels, OwningStruct)
    texels = levels.owners[1]
    assert isinstance(texels, np.ndarray)
    assert texels.flags.c_contiguous
    inner = texels[1:-1, 1:-1]
    light = linear_from_srgb(image / 255.0).reshape(shape[0], 2, shape[1], 2, 3)
    # Half a step: a 40th of a grey level where the sRGB curve is steepest.
    np.testing.assert_allclose(inner, 65535 * light.mean(axis=(1, 3)), atol=0.51)
    np.testing.assert_array_equal(texels, np.pad(inner, ((1, 1), (1, 1), (0, 0)), mode="wrap"))


GREY = Material((0.5, 0.5, 0.5))
AT = Pose.from_rpy((0.3, -0.2, 0.7), (0.4, 0.2, 1.0))


def make_scene(*shapes: Shape, material: Material = GREY) -> SceneMesh:
    """Shapes of one material at one pose."""
    items = tuple(Item(f"i{n}", shape, AT, material) for n, shape in enumerate(shapes))
    return build_scene(World("w", items))


def find_surfaces(scene: SceneMesh, *, threads: int = 1, instruction_set: str = "") -> FlatSurfaces:
    """Surfaces by a device of its own."""
    device = KernelDevice(instruction_set or choose_instruction_set(), threads)
    try:
        return find_flat_surfaces(scene, device)
    finally:
        device.close()


def outer_edge_lengths(scene: SceneMesh, surfaces: FlatSurfaces) -> list[float]:
    """Lengths of the outer edges of all surfaces, sorted."""
    lengths = np.linalg.norm(np.roll(scene.corners, -1, axis=1) - scene.corners, axis=-1)
    is_outer = surfaces.outer_edges[:, None] >> np.arange(3) & 1
    return sorted(lengths[is_outer.astype(bool)].tolist())


def test_box_has_six_surfaces_that_its_twelve_edges_bound_on_both_sides() -> None:
    scene = make_scene(Box((1.0, 2.0, 3.0)))
    surfaces = find_surfaces(scene)
    assert len(surfaces.representative) == 6
    assert np.bincount(surfaces.surface).tolist() == [2] * 6
    np.testing.assert_allclose(outer_edge_lengths(scene, surfaces), np.repeat([1.0, 2.0, 3.0], 8))


def test_representative_of_a_surface_is_its_largest_triangle() -> None:
    scene = make_scene(Rectangle((2.0, 2.0)), Cylinder(0.5, 1.0))
    surfaces = find_surfaces(scene)
    cross = np.cross(
        scene.corners[:, 1] - scene.corners[:, 0], scene.corners[:, 2] - scene.corners[:, 0]
    )
    area = 0.5 * np.linalg.norm(cross, axis=-1)
    for number, triangle in enumerate(surfaces.representative):
        members = np.flatnonzero(surfaces.surface == number)
        assert triangle in members
        assert area[triangle] == pytest.approx(area[members].max())


def test_edges_between_facets_of_a_curved_surface_are_outer() -> None:
    surfaces = find_surfaces(make_scene(SphereBand(0.5, 0.1, 3.0, 9, 4)))
    quads = len(surfaces.representative)
    assert quads == 9 * 4
    # Of each quad's two triangles only the diagonal is inside.
    assert [mask.bit_count() for mask in surfaces.outer_edges.tolist()] == [2] * (2 * quads)


def test_ring_is_one_surface_with_outer_edges_along_both_circles() -> None:
    scene = make_scene(Ring(0.5, 1.0, sectors=12))
    surfaces = find_surfaces(scene)
    assert len(surfaces.representative) == 1
    chord = 2.0 * np.sin(np.pi / 12.0)
    expected = np.repeat([0.5 * chord, chord], 12)
    np.testing.assert_allclose(outer_edge_lengths(scene, surfaces), expected)


def test_neighbours_when_of_two_colours_are_two_surfaces() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    albedo = scene.albedo.copy()
    albedo[1] = 0.7
    assert find_surfaces(scene).surface.tolist() == [0, 0]
    assert sum(m.bit_count() for m in find_surfaces(scene).outer_edges.tolist()) == 4
    painted = find_surfaces(replace(scene, albedo=albedo))
    assert painted.surface.tolist() == [0, 1]
    assert painted.outer_edges.tolist() == [7, 7]


def test_neighbours_when_one_is_unlit_are_two_surfaces() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    surfaces = find_surfaces(replace(scene, unlit=np.array([True, False])))
    assert surfaces.surface.tolist() == [0, 1]


def test_triangles_whose_colour_varies_are_surfaces_of_their_own() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)), Rectangle((2.0, 2.0)))
    colours = np.full((4, 3, 3), 0.5)
    colours[:2, 0] = 0.8
    coloured = replace(scene, corner_albedo=colours)
    assert find_surfaces(coloured).surface.tolist() == [0, 1, 2, 2]


@pytest.mark.parametrize(("shift", "count"), [(0.0, 1), (0.25, 2)])
def test_neighbours_when_their_texture_does_not_go_on_are_two_surfaces(
    tmp_path: Path, shift: float, count: int
) -> None:
    material = Material((1.0, 1.0, 1.0), write_smooth_texture(tmp_path / "t.png"))
    scene = make_scene(Rectangle((1.0, 2.0), (3.0, 2.0)), material=material)
    uv = scene.uv.copy()
    uv[1] += shift
    assert len(find_surfaces(replace(scene, uv=uv)).representative) == count


def test_triangles_when_they_occur_twice_keep_their_outer_edges() -> None:
    # Both lie on the same side of each shared edge: nothing continues beyond it.
    scene = make_scene(Rectangle((1.0, 2.0)), Rectangle((1.0, 2.0)))
    surfaces = find_surfaces(scene)
    assert outer_edge_lengths(scene, surfaces)[-4:] == pytest.approx([5.0**0.5] * 4)
    assert len(outer_edge_lengths(scene, surfaces)) == 12


def take_triangles(scene: SceneMesh, rows: Sequence[int] | npt.NDArray[np.intp]) -> SceneMesh:
    """Some triangles of a scene without colours at corners, in an order."""
    names = ("corners", "normals", "uv", "albedo", "unlit", "texture_index", "item_index")
    arrays = (*names, "casts_shadows", "object_index")
    return replace(scene, **{name: getattr(scene, name)[rows] for name in arrays})


def test_edge_when_three_triangles_share_it_is_outer() -> None:
    tripled = take_triangles(make_scene(Rectangle((1.0, 1.0))), [0, 1, 0])
    assert find_surfaces(tripled).outer_edges.tolist() == [7, 7, 7]


def test_triangle_without_area_is_joined_to_none() -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    corners = scene.corners.copy()
    corners[1, 2] = corners[1, 1]
    normals = scene.normals.copy()
    normals[1] = 0.0
    surfaces = find_surfaces(replace(scene, corners=corners, normals=normals))
    assert surfaces.surface.tolist() == [0, 1]
    assert surfaces.outer_edges[0] == 7


def make_sheet(side: int) -> SceneMesh:
    """A level square of 2 side^2 triangles, shuffled, each beginning with any of its corners."""
    rng = np.random.default_rng(5)
    column, row = np.divmod(np.arange(side * side), side)
    first, right = np.stack((column, row), axis=-1), np.array((1, 0))
    low = np.stack((first, first + right, first + 1), axis=1)
    high = np.stack((first, first + 1, first + 1 - right), axis=1)
    corners = np.zeros((2 * side * side, 3, 3))
    corners[..., :2] = 0.1 * np.concatenate((low, high))
    scene = take_triangles(make_scene(Rectangle((1.0, 1.0))), np.zeros(len(corners), dtype=np.intp))
    turns = (np.arange(3) + rng.integers(0, 3, (len(corners), 1))) % 3
    corners = np.take_along_axis(corners, turns[..., None], axis=1)[rng.permutation(len(corners))]
    return replace(scene, corners=corners, normals=np.tile((0.0, 0.0, 1.0), (len(corners), 1)))


@pytest.mark.parametrize("side", [1, 7, 60, 300])
def test_sheet_of_many_triangles_is_one_surface_within_its_border(side: int) -> None:
    scene = make_sheet(side)
    surfaces = find_surfaces(scene, threads=2)
    assert len(surfaces.representative) == 1
    assert not surfaces.surface.any()
    assert outer_edge_lengths(scene, surfaces) == pytest.approx([0.1] * 4 * side)


def test_surfaces_are_the_same_with_all_threads_and_instruction_sets() -> None:
    shapes = (SphereBand(0.5, 0.1, 3.0, 90, 40), Box((3.0, 2.0, 1.0)), Ring(0.5, 1.0, sectors=700))
    scene = make_scene(*shapes)
    expected = find_surfaces(scene)
    sets = available_instruction_sets()
    for threads, name in ((2, ""), (3, ""), (4, ""), *((2, name) for name in sets)):
        found = find_surfaces(scene, threads=threads, instruction_set=name)
        np.testing.assert_array_equal(found.surface, expected.surface)
        np.testing.assert_array_equal(found.outer_edges, expected.outer_edges)
        np.testing.assert_array_equal(found.representative, expected.representative)


def test_scene_without_triangles_has_no_surfaces() -> None:
    surfaces = find_surfaces(build_scene(World("w", ())))
    assert len(surfaces.surface) == len(surfaces.outer_edges) == len(surfaces.representative) == 0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e18, 1e300])
def test_triangles_when_rays_meet_none_are_joined_to_none(value: float) -> None:
    scene = make_scene(Rectangle((1.0, 1.0)))
    corners = scene.corners.copy()
    corners[1, 2, 2] = value
    # So far away is the centre of the scene, the origin of the rays' coordinates.
    assert find_surfaces(replace(scene, corners=corners)).outer_edges.tolist() == [7, 7]


def test_many_copies_of_one_triangle_are_surfaces_of_their_own() -> None:
    scene = take_triangles(make_scene(Rectangle((1.0, 1.0))), np.zeros(100_000, dtype=np.intp))
    surfaces = find_surfaces(scene, threads=2)
    np.testing.assert_array_equal(surfaces.surface, np.arange(100_000))
    assert (surfaces.outer_edges == 7).all()
