"""The kernel's proofs that nothing occludes a light, by maps and shafts, against shadow rays alone.

C code: `src/light_map.c`, `src/height_map.c`, `src/light_shaft.c`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import MovingExposure
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)
from helpers.dynamic_objects import place_cube
from helpers.random_worlds import make_random_exposure
from helpers.trace_engines import make_row_table
from helpers.trace_kernels import make_omni_table, open_kernel

AMBIENT = HemisphereLight((0.2, 0.2, 0.2), (0.1, 0.1, 0.1))
GREY = Material((0.5, 0.5, 0.5))
TABLES = {
    "omni": make_omni_table(width_px=72),
    "4 samples": make_omni_table(width_px=48, samples=2),
    "rim at 150": make_omni_table(width_px=72, rim_deg=150.0),
    # Parts of four pixels are proven beside those of eight.
    "9 samples": make_omni_table(width_px=32, samples=3),
}
WORLDS_PER_TABLE = 40
OBLIQUE = DirectionalLight((0.6, 0.0, 0.8), (0.5, 0.5, 0.5))


def make_random_lights(rng: np.random.Generator) -> tuple[Light, ...]:
    """One or two oblique lights, the first from above; or up to two point lights among the
    items, one of which may be on a surface."""
    if rng.uniform() < 0.5:
        places = rng.uniform((-2.0, -2.0, -1.5), (2.0, 2.0, 0.0), (2, 3))
        lamps = [PointLight(tuple(place), (0.4, 0.3, 0.2)) for place in places]
        return (AMBIENT, *lamps[: rng.integers(1, 3)])
    directions = rng.normal(size=(2, 3))
    directions[0, 2] = abs(directions[0, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    first, second = (DirectionalLight(tuple(d), (0.5, 0.4, 0.3)) for d in directions)
    return (AMBIENT, first, second) if rng.uniform() < 0.3 else (AMBIENT, first)


def make_shadowed_exposure(seed: int) -> tuple[World, CameraState]:
    """A random world of lit surfaces, some of which let light through."""
    world, state = make_random_exposure(seed)
    rng = np.random.default_rng(seed + 10**6)
    items = tuple(
        replace(
            item,
            material=None if item.material is None else Material(item.material.albedo),
            casts_shadows=bool(seed % 4 or rng.uniform() < 0.7),
        )
        for item in world.items
    )
    lit = replace(world, items=items, lights=make_random_lights(rng))
    return lit, replace(state, has_shadows=True)


def count_differences(world: World, state: CameraState, table: RayTable) -> int:
    """Number of pixels that differ between proofs and rays by more than half a grey level."""
    with open_kernel(world) as engine:
        rays = engine.prepare(table)
        proven = rays.render_linear(state)
        scene, surfaces = engine._scene, engine._scene.surfaces
        maps, num_surfaces = scene.light_maps, surfaces.num_surfaces
        assert maps, "the engine built no maps"
        # Without surfaces no part of an image is proven to show one, nor its light by shafts.
        scene.light_maps, surfaces.num_surfaces = None, 0
        traced = rays.render_linear(state)
        scene.light_maps, surfaces.num_surfaces = maps, num_surfaces  # for its release
    return int((np.abs(proven - traced).max(axis=-1) > 1e-3).sum())


@pytest.mark.parametrize("table", TABLES, ids=str)
def test_shadows_of_random_worlds_by_proofs_are_those_by_rays(table: str) -> None:
    first = list(TABLES).index(table) * WORLDS_PER_TABLE
    seeds = range(first, first + WORLDS_PER_TABLE)
    assert [s for s in seeds if count_differences(*make_shadowed_exposure(s), TABLES[table])] == []


# Its map is around the middle: the ground and what stands on it far away are in the map's border.
@pytest.mark.parametrize("seed", range(0, 40, 2))
def test_shadows_by_proofs_on_a_wide_ground_are_those_by_rays(seed: int) -> None:
    world, state = make_shadowed_exposure(8 * seed + 1)
    grid = [Pose.from_rpy((x, y, 0.9)) for x in (-1.5, -0.5, 0.5, 1.5) for y in (-1.0, 0.0, 1.0)]
    near = [Item(f"n{i}", Box((0.2, 0.2, 0.2)), pose, GREY) for i, pose in enumerate(grid)]
    wall = Rectangle((30.0, 60.0)), Pose.from_rpy((40.0, 0.0, -10.0), (0.0, 1.2, 0.3 * seed))
    ground = Rectangle((300.0, 300.0)), Pose.from_rpy((0.0, 0.0, 1.0))
    far = [Item(f"f{i}", *one, GREY) for i, one in enumerate((wall, ground))]
    world = replace(world, items=(*world.items, *near, *far))
    assert count_differences(world, state, TABLES["omni"]) == 0


# By rounding a shadow ray of this world meets the sliver on which it begins.
def test_ray_to_a_light_never_meets_the_facet_where_it_begins() -> None:
    exposure = make_shadowed_exposure(639)
    assert [name for name in TABLES if count_differences(*exposure, TABLES[name])] == []


@pytest.mark.parametrize("height_m", [1e-3, 0.01, 0.3])
def test_shadow_of_a_plate_near_the_floor_is_seen(height_m: float) -> None:
    floor = Item("floor", Rectangle((6.0, 6.0)), Pose.identity(), GREY)
    plate = Item("plate", Box((0.5, 0.3, 1e-3)), Pose.from_rpy((0.3, 0.2, -height_m)), GREY)
    light = DirectionalLight((0.6, 0.0, 0.8), (0.5, 0.5, 0.5))
    world = World("w", (floor, plate), lights=(AMBIENT, light))
    state = CameraState(Pose.from_rpy((0.0, 0.0, -0.6)), has_shadows=True)
    for table in TABLES.values():
        assert count_differences(world, state, table) == 0


@pytest.mark.parametrize("height_m", [0.1, 1.0, 50.0])
def test_shadow_of_an_object_outside_the_scene_is_seen(height_m: float) -> None:
    floor = Item("floor", Rectangle((2.0, 2.0)), Pose.identity(), GREY)
    light = DirectionalLight((0.6, 0.0, 0.8), (0.5, 0.5, 0.5))
    world = World("w", (floor,), lights=(AMBIENT, light))
    cube = place_cube(-0.75 * height_m, 0.1, -height_m)
    state = CameraState(Pose.from_rpy((0.5, 0.5, -0.6)), (cube,), has_shadows=True)
    table = TABLES["omni"]
    assert count_differences(world, state, table) == 0
    with open_kernel(world) as engine:
        rays = engine.prepare(table)
        shadowed, lit = rays.render_srgb(state), rays.render_srgb(replace(state, objects=()))
    assert (shadowed != lit).any()


@pytest.mark.parametrize("height_m", [0.3, 1.0, 1.9])
def test_shadow_of_an_object_between_lamp_and_floor_is_seen(height_m: float) -> None:
    floor = Item("floor", Rectangle((4.0, 4.0)), Pose.identity(), GREY)
    lamp = PointLight((0.31, 0.23, -2.0), (0.8, 0.7, 0.6))  # no sample on an edge of a shadow
    world = World("w", (floor,), lights=(AMBIENT, lamp))
    table = TABLES["4 samples"]
    for x in np.linspace(-1.5, 1.5, 7):
        state = CameraState(Pose.from_rpy((0.5, 0.5, -0.6)), (place_cube(x, 0.1, -height_m),))
        state = replace(state, has_shadows=True)
        assert count_differences(world, state, table) == 0
    with open_kernel(world) as engine:
        rays = engine.prepare(table)
        state = replace(state, objects=(place_cube(0.2, 0.2, -height_m),))
        shadowed, lit = rays.render_srgb(state), rays.render_srgb(replace(state, objects=()))
    assert (shadowed != lit).any()


@pytest.mark.parametrize("light", [PointLight((0.3, 0.2, -2.0), (0.8,) * 3), OBLIQUE], ids=str)
def test_shadow_of_an_object_that_moves_during_the_exposure_is_that_by_rays(light: Light) -> None:
    floor = Item("floor", Rectangle((6.0, 6.0)), Pose.identity(), GREY)
    world = World("w", (floor,), lights=(AMBIENT, light))
    rng = np.random.default_rng(4)
    directions = rng.normal((0.0, 0.0, 1.5), 1.0, (2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    table = make_row_table(directions, times=rng.uniform(size=2000))
    cubes = [place_cube(x, 0.1, -0.8, size_m=0.2) for x in (-1.5, 0.0, 1.5)]
    moving = [replace(cube, mesh=cubes[0].mesh) for cube in cubes]
    states = tuple(
        CameraState(Pose.from_rpy((0.5, 0.5, -0.4)), (cube,), has_shadows=True) for cube in moving
    )
    with open_kernel(world) as engine:
        rays = engine.prepare(table)
        exposure = MovingExposure(states)
        mapped = rays.render_linear(exposure)
        maps, engine._scene.light_maps = engine._scene.light_maps, None
        traced = rays.render_linear(exposure)
        engine._scene.light_maps = maps  # for its release
        lit = rays.render_linear(states[0])
    np.testing.assert_allclose(mapped, traced, atol=1e-6)
    assert (np.abs(mapped - lit).max(axis=-1) > 1e-2).any()
