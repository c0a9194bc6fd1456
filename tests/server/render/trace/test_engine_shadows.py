"""Shadows for each engine: on the scene, on objects, far from the origin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import Box, DirectionalLight, PointLight, World
from helpers.shadows import GREY, box_item, floor_item, make_world
from helpers.trace_engines import ENGINES, render_rays
from helpers.worlds import translate_world

pytestmark = pytest.mark.parametrize("engine", ENGINES)

NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
LAMP = PointLight((0.0, 0.0, -1.0), (0.5, 0.5, 0.5))
TABLE = box_item(0.0, 0.0, -0.5, (0.4, 0.4, 0.02))
DOWN, UP, AHEAD = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)


PLACES = np.array(((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))


def irradiance(
    engine: EngineName, world: World, *objects: DynamicObject, places: Floats = PLACES
) -> list[float]:
    """Irradiance of places on the grey floor, seen from 0.1 m above each of them."""
    exposure = CameraState(Pose.from_rpy(places[0]), objects, has_shadows=True)
    origins = places - places[0] - (0.0, 0.0, 0.1)
    seen = render_rays(engine, world, np.tile(DOWN, (len(places), 1)), origins, exposure=exposure)
    found: list[float] = (seen[:, 0] / GREY.albedo[0]).tolist()
    return found


def test_place_under_a_table_is_shadowed_and_another_is_not(engine: EngineName) -> None:
    world = make_world(floor_item(), TABLE, lights=(NOON,))
    assert irradiance(engine, world) == [0.0, 0.5]


def test_place_when_the_table_is_beyond_the_point_light_is_lit(engine: EngineName) -> None:
    above = box_item(0.0, 0.0, -1.5, (0.4, 0.4, 0.02))
    lit = irradiance(engine, make_world(floor_item(), above, lights=(LAMP,)))
    assert lit[0] == pytest.approx(0.5, rel=1e-4)
    assert irradiance(engine, make_world(floor_item(), TABLE, lights=(LAMP,)))[0] == 0.0


def test_place_under_an_item_without_shadow_is_lit(engine: EngineName) -> None:
    glass = replace(TABLE, casts_shadows=False)
    assert irradiance(engine, make_world(floor_item(), glass, lights=(NOON,))) == [0.5, 0.5]
    clear = replace(floor_item(), casts_shadows=False)
    assert irradiance(engine, make_world(clear, lights=(NOON,))) == [0.5, 0.5]


def test_place_under_an_object_is_shadowed(engine: EngineName) -> None:
    mesh = build_object_mesh([(box(Box((0.4, 0.4, 0.02))), GREY)])
    above = DynamicObject(mesh, Pose.from_rpy((0.0, 0.0, -0.5), (0.1, 0.2, 0.3)))
    world = make_world(floor_item(), lights=(NOON,))
    assert irradiance(engine, world, above) == [0.0, 0.5]
    below = replace(above, world_from_object=Pose.from_rpy((0.0, 0.0, 0.5)))
    assert irradiance(engine, world, below) == [0.5, 0.5]


def test_object_under_the_scene_and_under_another_object_is_shadowed(engine: EngineName) -> None:
    mesh = build_object_mesh([(box(Box((0.2, 0.2, 0.2))), GREY)])
    low = DynamicObject(mesh, Pose.from_rpy((0.0, 0.0, 0.0)))
    high = DynamicObject(mesh, Pose.from_rpy((0.0, 0.0, -1.0)))
    for items, objects in (((TABLE,), (low,)), ((), (low, high))):
        world = make_world(*items, lights=(NOON,))
        exposure = CameraState(Pose.identity(), objects, has_shadows=True)
        lit, hidden = (
            render_rays(engine, world, DOWN, ((0.0, 0.0, -0.2),), exposure=e)[0, 0]
            for e in (replace(exposure, has_shadows=False), exposure)
        )
        assert (lit, hidden) == (pytest.approx(0.25), 0.0)


@pytest.mark.parametrize("far_m", [0.0, 1e4])
def test_facet_when_positions_are_rounded_does_not_shadow_itself(
    engine: EngineName, far_m: float
) -> None:
    low = DirectionalLight((0.9999, 0.0, 0.01414), (70.7, 70.7, 70.7))
    offset = (far_m, 0.0, far_m)
    world = translate_world(make_world(floor_item(20.0), lights=(low,)), offset)
    places = np.random.default_rng(2).uniform(-9.5, 9.5, (40, 3)) * (1.0, 1.0, 0.0)
    found = irradiance(engine, world, places=places + offset)
    assert found == pytest.approx([1.0] * 40, rel=1e-3)
