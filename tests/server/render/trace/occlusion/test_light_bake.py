"""Baked light against furnaces, rays of its own and itself on other processors."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.render.trace.kernel.library import available_instruction_sets
from catoptra_server.render.trace.occlusion.light_bake import BakedLight, LightBake
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
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


def bake(
    scene: SceneMesh,
    world: World,
    passes: int = 2,
    *,
    threads: int = 1,
    instruction_set: str | None = None,
) -> BakedLight:
    light = LightBake(
        scene, world, threads=threads, max_passes=passes, instruction_set=instruction_set
    )
    try:
        for _ in range(passes):
            light.cast()
        return light.gather()
    finally:
        light.close()


@pytest.mark.parametrize("room", ROOMS)
def test_furnace_has_one_light_everywhere(room: str) -> None:
    # Of every wall 0.25 of its own, and half of what reaches it: 0.25 / (1 - 0.5).
    world = World(room, ROOMS[room])
    scene = build_scene(world)
    scene = replace(scene, emission=np.full((len(scene), 3), 0.25))
    light = bake(scene, world)
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
            light = bake(scene, world, threads=threads, instruction_set=name)
            arrays = (light.occlusion.texels, light.brightest, light.error)
            digests.add(hashlib.sha256(b"".join(one.tobytes() for one in arrays)).hexdigest())
    assert len(digests) == 1


def measure_levels(scene: SceneMesh, light: BakedLight, exact: Floats, nodes: Floats) -> Floats:
    raise NotImplementedError
