"""Rays to lights: from just before a facet, past triangles that cast no shadow, to the light."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.render.trace.shadow_rays import ShadowRays, make_occlusion_query
from catoptra_server.scene.dynamic_object import DynamicObject, build_object_mesh
from catoptra_server.scene.primitives import box
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import Box, DirectionalLight, PointLight, World
from helpers.shadows import GREY, box_item, floor_item, make_world
from helpers.worlds import translate_world

NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
LIGHT = PointLight((0.0, 0.0, -1.0), (0.5, 0.5, 0.5))
TABLE = box_item(0.0, 0.0, -0.5, (0.4, 0.4, 0.02))
PLACES = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
UP = np.tile((0.0, 0.0, -1.0), (2, 1))


def irradiance(world: World, positions: Floats = PLACES, *objects: DynamicObject) -> list[float]:
    scene = build_scene(world)
    embree = EmbreeScene(scene, world)
    rays = ShadowRays(make_occlusion_query(embree, scene), embree.origin, world.lights)
    placed = EmbreeObjectScenes(()).place_objects(objects, np.zeros(3), SrgbScale.for_samples(1))
    found: list[float] = rays.irradiance(positions - embree.origin, UP, placed)[:, 0].tolist()
    return found


def test_point_under_a_table_is_shadowed_and_another_is_not() -> None:
    assert irradiance(make_world(floor_item(), TABLE, lights=(NOON,))) == [0.0, 0.5]


def test_point_when_the_table_is_beyond_the_point_light_is_lit() -> None:
    above = box_item(0.0, 0.0, -1.5, (0.4, 0.4, 0.02))
    assert irradiance(make_world(floor_item(), above, lights=(LIGHT,)))[0] == pytest.approx(
        0.5, rel=1e-4
    )
    assert irradiance(make_world(floor_item(), TABLE, lights=(LIGHT,)))[0] == 0.0


def test_point_under_an_item_without_shadow_is_lit() -> None:
    glass = dataclasses.replace(TABLE, casts_shadows=False)
    assert irradiance(make_world(floor_item(), glass, lights=(NOON,))) == [0.5, 0.5]
    clear = dataclasses.replace(floor_item(), casts_shadows=False)
    assert irradiance(make_world(clear, lights=(NOON,))) == [0.5, 0.5]


def test_point_under_an_object_is_shadowed_from_the_directional_light() -> None:
    mesh = build_object_mesh([(box(Box((0.4, 0.4, 0.02))), GREY)])
    dynamic_object = DynamicObject(mesh, Pose.from_rpy((0.0, 0.0, -0.5), (0.1, 0.2, 0.3)))
    assert irradiance(make_world(floor_item(), lights=(NOON,)), PLACES, dynamic_object) == [
        0.0,
        0.5,
    ]
    below = dataclasses.replace(dynamic_object, world_from_object=Pose.from_rpy((0.0, 0.0, 0.5)))
    assert irradiance(make_world(floor_item(), lights=(NOON,)), PLACES, below) == [0.5, 0.5]


@pytest.mark.parametrize("far_m", [0.0, 1e4])
def test_facet_when_positions_are_rounded_does_not_shadow_itself(far_m: float) -> None:
    low = DirectionalLight((0.9999, 0.0, 0.01414), (70.7, 70.7, 70.7))
    world = translate_world(make_world(floor_item(20.0), lights=(low,)), (far_m, 0.0, far_m))
    positions = np.random.default_rng(2).uniform(-10.0, 10.0, (2, 3)) * (1.0, 1.0, 0.0)
    positions = np.add(positions, (far_m, 0.0, far_m)).astype(np.float32).astype(np.float64)
    assert irradiance(world, positions) == pytest.approx([1.0, 1.0], rel=1e-3)
