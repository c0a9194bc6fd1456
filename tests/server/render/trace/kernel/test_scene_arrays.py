"""Arrays of scenes, objects and lights as the kernel's structures point to them."""

from __future__ import annotations

import ctypes
import gc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel.kernel_structs import (
    FACET_CORNER_COLOURS,
    FACET_TEXTURED,
    FACET_UNLIT,
    LIGHT_DIRECTIONAL,
    LIGHT_POINT,
    TextureStruct,
)
from catoptra_server.render.trace.kernel.scene_arrays import (
    Owned,
    caster_arrays,
    encoded_table,
    hemisphere_struct,
    light_array,
    object_arrays,
    radiance_table,
    scene_arrays,
    surfaces_struct,
    texture_array,
)
from catoptra_server.world import shading
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import (
    Box,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    Ring,
    SphereBand,
    World,
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


def test_scene_s_arrays_are_relative_to_its_centre_and_padded() -> None:
    near = build_scene(make_test_world())
    far = replace(near, corners=near.corners + FAR)
    owned = scene_arrays(far, FAR)
    arrays = owned.struct
    count = len(near)
    assert arrays.num_triangles == count
    # Subtracted in float64: at 20 km float32 alone would round to 2 mm.
    corners = read_array(arrays.corners, (count, 3, 3))
    np.testing.assert_allclose(corners, near.corners, atol=1e-6)
    # Four floats more, which Embree loads and ignores.
    assert read_array(arrays.corners, (9 * count + 4,))[-4:].tolist() == [0.0] * 4
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


def test_scene_s_texture_coordinates_are_a_corner_and_two_edges(textured: SceneMesh) -> None:
    owned = scene_arrays(textured, np.zeros(3))
    arrays = owned.struct
    frames = read_array(arrays.uv, (len(textured), 3, 2))
    whole = frames.copy()
    whole[:, 1:] += frames[:, :1]
    np.testing.assert_allclose(whole, textured.uv, atol=1e-6)
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
    wide = replace(textured, textures=(textured.textures[0], textured.textures[0][:3, :5]))
    owned = texture_array(wide)
    second = owned.owners[1]
    assert isinstance(second, Owned)
    assert [struct.num_levels for struct in owned.struct] == [7, 3]
    assert owned.struct[1].levels == ctypes.addressof(second.struct)
    sizes = [(level.width, level.height) for level in second.struct]
    assert sizes == [(5, 3), (2, 1), (1, 1)]
    np.testing.assert_array_equal(
        read_array(second.struct[0].texels, (5, 7, 4), np.uint16), second.owners[0]
    )


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


def make_ball(centre: Floats) -> SceneMesh:
    """A fine ball, whose triangles go into spheres, on a large floor."""
    pose = Pose.from_rpy(tuple(centre))
    items = (
        Item("ball", SphereBand(0.2, 0.0, 3.1, 80, 40), pose, Material((0.5, 0.5, 0.5))),
        Item("floor", Rectangle((5.0, 5.0)), pose, Material((0.5, 0.5, 0.5))),
    )
    return build_scene(World("w", items))


def test_spheres_enclose_small_triangles_also_after_rounding() -> None:
    scene = make_ball(FAR)
    centre = FAR + np.array((1e3, 0.0, 0.0))
    owned = surfaces_struct(scene, centre)
    struct = owned.struct
    spheres = read_array(struct.clusters, (struct.num_clusters, 4)).astype(np.float64)
    large = read_array(struct.triangles, (struct.num_triangles,), np.int32)
    small = np.delete(scene.corners, large, axis=0) - centre
    # As Embree gets them: rounded to float32.
    small = small.astype(np.float32).astype(np.float64)
    away = np.linalg.norm(small[:, :, None] - spheres[:, :3], axis=-1)
    assert (away <= spheres[:, 3]).all(axis=1).any(axis=1).all()


def test_surfaces_name_triangles_edges_and_representatives() -> None:
    scene = build_scene(
        World("w", (Item("box", Box((1, 2, 3)), Pose.identity(), Material((0.5, 0.5, 0.5))),))
    )
    owned = surfaces_struct(scene, np.zeros(3))
    struct = owned.struct
    assert (struct.num_triangles, struct.num_surfaces, struct.num_clusters) == (12, 6, 0)
    surface = read_array(struct.surface, (12,), np.int32)
    representative = read_array(struct.representative, (6,), np.int32)
    np.testing.assert_array_equal(surface[representative], np.arange(6))
    edges = read_array(struct.outer_edges, (12,), np.uint8)
    assert [int(mask).bit_count() for mask in edges] == [2] * 12


def test_radiance_of_facets_is_that_of_the_shading_model_and_ends_with_the_background() -> None:
    scene = build_scene(make_test_world())
    lights = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
    table = radiance_table(scene, lights, (0.1, 0.2, 0.3))
    np.testing.assert_allclose(table[:-1], shading.facet_radiance(scene, lights), rtol=1e-6)
    np.testing.assert_allclose(table[-1], (0.1, 0.2, 0.3), rtol=1e-6)
    assert table.dtype == np.float32


def test_tables_of_many_facets_take_little_memory_beside_themselves() -> None:
    ring = Item("ring", Ring(0.5, 1.0, sectors=150_000), Pose.identity(), Material((0.5, 0.5, 0.5)))
    scene = build_scene(World("w", (ring,)))
    lights = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)
    peak = peak_bytes(lambda: encoded_table(radiance_table(scene, lights, (0.1, 0.2, 0.3))))
    # 12 and 4 bytes a facet, and blocks; float64 in between took 48 more.
    assert peak < 32 * len(scene)


def test_encoded_radiance_has_red_in_the_lowest_byte_and_is_clipped() -> None:
    radiance = np.array([(1.0, 0.0, 0.2158605), (7.0, -1.0, 0.0)], dtype=np.float32)
    assert encoded_table(radiance).tolist() == [0x8000FF, 0x0000FF]


def test_encoded_radiance_when_no_number_is_black() -> None:
    radiance = np.array([(np.nan, np.inf, -np.inf)], dtype=np.float32)
    assert encoded_table(radiance).tolist() == [0x00FF00]
