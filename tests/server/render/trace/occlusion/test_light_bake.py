"""Baked light against furnaces, rays of its own and itself on other processors."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel.library import available_instruction_sets
from catoptra_server.render.trace.occlusion import light_bake
from catoptra_server.render.trace.occlusion.light_bake import (
    MAX_PASSES,
    RAYS_PER_PASS,
    bake_light,
)
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    HemisphereLight,
    Item,
    Material,
    RectangleLight,
    SphereBand,
    World,
    srgb_from_linear,
)
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.image_comparison import level_differences
from helpers.trace_engines import ENGINES, open_engine
from helpers.trace_kernels import make_omni_table, open_kernel, render_filled_and_traced
from helpers.worlds import DIRECTIONAL_LIGHT, HEMISPHERE_LIGHT, make_test_world

GREY = Material((0.5, 0.5, 0.5))
INDOORS = Path(__file__).parents[5] / "configs/worlds/warehouse.ini"


def make_items(*placed: tuple[object, tuple[float, float, float]]) -> tuple[Item, ...]:
    return tuple(
        Item(f"item {number}", shape, Pose.from_rpy(place), GREY)  # type: ignore[arg-type]
        for number, (shape, place) in enumerate(placed)
    )


SIX_WALLS = make_items(
    *((Box((4.4, 4.4, 0.2)), (0.0, 0.0, z)) for z in (-3.1, 0.1)),
    *((Box((0.2, 4.4, 3.0)), (x, 0.0, -1.5)) for x in (-2.1, 2.1)),
    *((Box((4.0, 0.2, 3.0)), (0.0, y, -1.5)) for y in (-2.1, 2.1)),
)
ROOMS = {
    "walls": SIX_WALLS,
    "furnished": SIX_WALLS
    + make_items(
        (Box((0.6, 0.4, 0.5)), (0.8, 0.3, -0.25)),
        (Cylinder(0.3, 1.0, sectors=16), (-1.0, -0.8, -0.6)),
    ),
    "sphere": make_items((SphereBand(2.0, 0.0, np.pi, sectors=24, rings=12), (0.0, 0.0, -1.5))),
}


@pytest.mark.parametrize("room", ROOMS)
def test_furnace_has_one_light_everywhere(room: str) -> None:
    # Of every wall 0.25 of its own, and half of what reaches it: 0.25 / (1 - 0.5).
    world = World(room, ROOMS[room])
    scene = build_scene(world)
    scene = replace(scene, emission=np.full((len(scene), 3), 0.25))
    light = bake_light(scene, world, 2, threads=1)
    rays = np.random.default_rng(1).normal(size=(2000, 3))
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    origins = np.tile([0.1, -0.2, -1.6], (len(rays), 1))
    distances, triangles = commit_ray_caster(scene).closest_triangles(origins, rays)
    factors = light.occlusion.factors(triangles, origins + distances[:, None] * rays)
    np.testing.assert_allclose(light.brightest * factors, 0.5, rtol=1e-5)


def make_lamp_world() -> World:
    lamp = RectangleLight((0.5, 0.0, -2.9), (0.0, 0.0, 1.0), (0.6, 0.4), (3.0, 2.0, 1.0))
    sky = HemisphereLight((0.4, 0.5, 0.6), (0.1, 0.1, 0.1))
    return World("lamp", ROOMS["furnished"][1:], lights=(sky,), area_lights=(lamp,))


def test_bytes_depend_on_neither_threads_nor_processor() -> None:
    world = make_lamp_world()
    scene = build_scene(world)
    digests = set()
    for threads in (1, 2, 3, 4):
        for name in available_instruction_sets():
            light = bake_light(scene, world, 2, threads=threads, instruction_set=name)
            arrays = (light.occlusion.texels, light.brightest, light.error)
            digests.add(hashlib.sha256(b"".join(one.tobytes() for one in arrays)).hexdigest())
    assert len(digests) == 1


def test_errors_that_are_stated_cover_those_against_4096_rays(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(light_bake, "MAX_NODES", 8000)
    world = make_lamp_world()
    scene = build_scene(world)
    light = bake_light(scene, world, MAX_PASSES, threads=2)
    exact = bake_light(scene, world, 4096 // RAYS_PER_PASS, threads=2)
    is_node = np.zeros(light.error.shape[:2], dtype=bool)
    for left, top, right, bottom in light.occlusion.bounds.tolist():
        is_node[top : bottom + 1, left : right + 1] = True
    values, truth = (
        (one.brightest * np.moveaxis(one.occlusion.texels, 0, -1) / 65535)[is_node]
        for one in (light, exact)
    )
    difference = np.abs(values - truth)
    assert (difference <= light.error[is_node] + exact.error[is_node]).mean() > 0.99
    levels = 255.0 * np.abs(srgb_from_linear(0.5 * values) - srgb_from_linear(0.5 * truth))
    assert np.median(levels) < 1.0
    assert np.percentile(levels, 99.0) < 6.0


def test_both_engines_draw_baked_light_on_surfaces_and_objects() -> None:
    lamp = RectangleLight((0.4, 0.3, -1.8), (0.0, 0.0, 1.0), (0.5, 0.3), (2.0, 1.0, 0.5))
    world = replace(
        make_test_world(lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT)),
        area_lights=(lamp,),
    )
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=1).apply(scene, world)
    exposure = CameraState(
        Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3)), TWO_ROBOTS, has_shadows=True
    )
    table = make_omni_table(width_px=96, samples=2)
    pictures = []
    for name in ENGINES:
        with open_engine(name, world, scene=scene) as engine:
            pictures.append(engine.prepare(table).render_srgb(exposure))
    differences = level_differences(*pictures)
    # Edges round to other surfaces; a pixel's centre in place of its samples' mean.
    assert np.percentile(differences, 99.5) <= 1
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=2))
        filled, traced, share = render_filled_and_traced(engine, rays, exposure)
    assert share > 0.2
    assert level_differences(filled, traced).max() <= 2


def test_filled_tiles_of_textures_have_the_light_of_their_own_pixels(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), "white").save(tmp_path / "white.png")
    world = make_test_world(lights=(HEMISPHERE_LIGHT,), texture=tmp_path / "white.png")
    scene = build_scene(world)
    scene, world = bake_light(scene, world, 2, threads=1).apply(scene, world)
    assert scene.occlusion is not None
    # Light that is much steeper than that of lamps.
    shape = scene.occlusion.texels.shape
    texels = np.random.default_rng(5).integers(45000, 65536, shape, np.uint16)
    scene = replace(scene, occlusion=replace(scene.occlusion, texels=texels))
    with open_kernel(world, scene=scene) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=2))
        filled, traced, share = render_filled_and_traced(
            engine, rays, CameraState(Pose.from_rpy((0.31, 0.17, -0.6)))
        )
    assert share > 0.2
    assert np.percentile(level_differences(filled, traced), 99.9) <= 3


def test_light_that_is_the_same_everywhere_needs_no_map() -> None:
    world = replace(World("furnace", ROOMS["sphere"]), light_bake=True)
    scene = build_scene(world)
    scene = replace(scene, emission=np.full((len(scene), 3), 0.25))
    lit, lit_world = bake_light(scene, world, 2, threads=1).apply(scene, world)
    assert lit.occlusion is None
    (sky,) = lit_world.lights
    np.testing.assert_allclose(sky.up_irradiance, 0.5, rtol=1e-5)  # type: ignore[union-attr]
