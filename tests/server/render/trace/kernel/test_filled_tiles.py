"""The kernel's proof that one surface fills a part of an image, against tracing every ray.

C code: `src/coverage.c`. Where light is constant over facets both images are equal to the byte.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.kernel import kernel_engine
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, face_ray_table, lens_ray_table
from catoptra_server.world.world_description import (
    HemisphereLight,
    Item,
    Material,
    PointLight,
    Ring,
    SphereBand,
)
from helpers.dynamic_objects import TWO_ROBOTS, place_cube
from helpers.image_comparison import level_differences
from helpers.random_worlds import make_random_exposure
from helpers.trace_kernels import count_differences, fill_and_trace, make_omni_table, open_kernel
from helpers.worlds import (
    CAMERA_STATE,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_test_world,
    write_smooth_texture,
)
from measurements import scenes

# Widths that are no multiple of a tile, an upright and a wide image.
TABLES = {
    "omni": make_omni_table(width_px=72),
    "omni, 4 samples": make_omni_table(width_px=58, samples=2),
    "omni, 16 samples": make_omni_table(width_px=32, samples=4),
    "rim at 150": make_omni_table(width_px=90, rim_deg=150.0),
    "rim at 170": make_omni_table(width_px=72, rim_deg=170.0),
    "face ahead": face_ray_table(FaceCamera(Face.N, 61), 1),
    "face below, 4 samples": face_ray_table(FaceCamera(Face.C, 40), 2),
    "perspective": lens_ray_table(PerspectiveCamera(80, 37, 1.2), 1),
}
WORLDS_PER_TABLE = 28
GREY = Material((0.5, 0.5, 0.5), unlit=True)


@pytest.mark.parametrize("table", TABLES, ids=str)
def test_image_of_random_worlds_when_filled_is_the_traced_one(table: str) -> None:
    first = list(TABLES).index(table) * WORLDS_PER_TABLE
    different, filled_tiles, tiles = [], 0.0, 0
    for seed in range(first, first + WORLDS_PER_TABLE):
        world, state = make_random_exposure(seed)
        filled, traced, share = fill_and_trace(world, state, TABLES[table])
        different += [seed] if (filled != traced).any() else []
        filled_tiles, tiles = filled_tiles + share, tiles + 1
    assert different == []
    # Else the comparison would compare nothing.
    assert filled_tiles / tiles > 0.25


def test_few_rays_are_all_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    world, table = scenes.make_worlds()["field"], make_omni_table(width_px=72)
    num_rays = table.valid.size * BLOCK_RAYS
    shares = []
    for fewest in (num_rays, num_rays + 1):
        monkeypatch.setattr(kernel_engine, "MIN_PROVEN_RAYS", fewest)
        shares.append(fill_and_trace(world, scenes.CAMERA_STATE, table)[2])
    assert shares[0] > 0.0 == shares[1]


@pytest.mark.parametrize("table", ["omni", "omni, 4 samples"])
@pytest.mark.parametrize("name", ["field", "balls"])
def test_image_of_a_world_when_filled_is_the_traced_one(name: str, table: str) -> None:
    world = scenes.make_worlds()[name]
    for objects in ((), TWO_ROBOTS, (place_cube(0.5, 0.3, -0.6, size_m=0.3),)):
        state = replace(scenes.CAMERA_STATE, objects=objects)
        assert count_differences(world, state, TABLES[table]) == 0


@pytest.mark.parametrize("samples", [1, 2, 4])
def test_image_when_textures_or_lamps_vary_differs_by_one_level_from_the_traced_one(
    tmp_path: Path, samples: int
) -> None:
    texture = write_smooth_texture(tmp_path / "waves.png")
    table = make_omni_table(width_px=72, samples=samples)
    worlds = (
        make_test_world(texture=texture, lights=(HEMISPHERE_LIGHT, POINT_LIGHT)),
        make_test_world(texture=texture),
        read_world(scenes.CORRIDOR)[0],
    )
    for world in worlds:
        filled, traced, share = fill_and_trace(world, CAMERA_STATE, table)
        assert level_differences(filled, traced).max() <= 1
        assert share > 0.2


@pytest.mark.parametrize("samples", [1, 2])
def test_image_with_shadows_when_filled_differs_by_one_level_from_the_traced_one(
    samples: int,
) -> None:
    table = make_omni_table(width_px=72, samples=samples)
    lamp = PointLight((0.4, -0.5, -1.4), (0.9, 0.7, 0.4))
    world = replace(make_test_world(), lights=(*make_test_world().lights, lamp))
    for objects in ((), TWO_ROBOTS):
        state = replace(CAMERA_STATE, objects=objects, has_shadows=True)
        filled, traced, _ = fill_and_trace(world, state, table)
        assert level_differences(filled, traced).max() <= 1


@pytest.mark.parametrize("samples", [1, 2])
def test_light_when_filled_is_the_traced_one(samples: int) -> None:
    # Brighter than white, which sRGB would hide.
    bright = HemisphereLight((4.0, 3.0, 2.0), (1.0, 1.0, 1.0))
    table = make_omni_table(width_px=72, samples=samples)
    with open_kernel(make_test_world(lights=(bright,))) as engine:
        rays = engine.prepare(table)
        filled = rays.render_linear(CAMERA_STATE)
        assert rays.last_counts.num_filled_tiles > 0
        engine._scene.surfaces.num_surfaces = 0
        traced = rays.render_linear(CAMERA_STATE)
    np.testing.assert_array_equal(filled, traced)
    assert filled.max() > 1.0


# Triangles: more than a part of the image lists, larger than all others, tiny, and behind a wall.
CROWDS = {
    "ball around the camera": SphereBand(0.4, 0.3, 2.8, 400, 260),
    "dome": SphereBand(60.0, 0.5 * np.pi, np.pi - 0.001, 80, 36),
    "fine ball": SphereBand(0.2, 0.001, 3.14, 350, 300),
    "ring of slivers": Ring(0.3, 4.0, sectors=6000),
}


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("crowd", CROWDS)
def test_image_of_very_many_triangles_when_filled_is_the_traced_one(
    crowd: str, samples: int
) -> None:
    field = scenes.make_worlds()["field"]
    at = Pose.from_rpy((0.5, 0.3, -0.6) if "camera" in crowd else (1.1, -0.4, -0.15))
    world = replace(field, items=(*field.items, Item("crowd", CROWDS[crowd], at, GREY)))
    table = make_omni_table(width_px=136, samples=samples)
    for objects in ((), TWO_ROBOTS):
        state = replace(scenes.CAMERA_STATE, objects=objects)
        assert count_differences(world, state, table) == 0


@pytest.mark.parametrize("crowd", ["dome", "fine ball"])
def test_field_is_filled_whatever_else_there_is(crowd: str) -> None:
    field = scenes.make_worlds()["field"]
    item = Item("crowd", CROWDS[crowd], Pose.from_rpy((2.5, 1.5, -0.2)), GREY)
    shares = []
    for world in (field, replace(field, items=(*field.items, item))):
        with open_kernel(world) as engine:
            rays = engine.prepare(make_omni_table(width_px=320))
            rays.render_srgb(scenes.CAMERA_STATE)
            shares.append(rays.last_counts.num_filled_tiles / rays.last_counts.num_tiles)
    # The rim of the ball; the facets of the sky, where there was one.
    assert shares[1] > shares[0] - (0.02 if crowd == "fine ball" else 0.15)


@pytest.mark.parametrize(("samples", "share"), [(1, 0.75), (2, 0.82)])
def test_field_is_filled_for_the_most_part(samples: int, share: float) -> None:
    with open_kernel(scenes.make_worlds()["field"]) as engine:
        rays = engine.prepare(make_omni_table(width_px=640, samples=samples))
        rays.render_srgb(scenes.CAMERA_STATE)
        counts = rays.last_counts
    assert counts.num_filled_tiles / counts.num_tiles > share
