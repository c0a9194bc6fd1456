from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.light import grey_level_change
from catoptra_server.effects.bounds.shadows import ShadowBounds
from catoptra_server.effects.effect import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.world.objects import DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
)
from helpers.shadows import GREY, box_item, floor_item, make_world
from helpers.standing_things import bake_scene, make_box_world

SKY = HemisphereLight((0.3, 0.3, 0.3), (0.2, 0.2, 0.2))
NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
MESH = build_object_mesh([(box(Box((0.2, 0.2, 0.2))), GREY)])
BOX = box_item(0.0, 0.0, -0.2, (0.2, 0.2, 0.2))


def bound(world: World, *bodies: DynamicObject) -> ShadowLoss:
    return ShadowBounds(build_scene(world), world).darkest_shadow(bodies)


def test_floor_under_a_box_loses_the_directional_light_and_keeps_the_sky() -> None:
    shade = bound(make_world(floor_item(), BOX, lights=(SKY, NOON)))
    assert shade.lost_radiance == pytest.approx(0.5 * 0.5)
    assert shade.remaining_radiance == pytest.approx(0.5 * 0.3)


def test_brightest_corner_of_a_triangle_counts() -> None:
    world = make_world(floor_item(), BOX, lights=(SKY, NOON))
    scene = build_scene(world)
    corners = np.repeat(scene.albedo[:, None], 3, axis=1)
    corners[:, 1] = 0.8
    shade = ShadowBounds(replace(scene, corner_albedo=corners), world).darkest_shadow(())
    assert shade.lost_radiance == pytest.approx(0.8 * 0.5)
    assert shade.remaining_radiance == pytest.approx(0.8 * 0.3)


def test_floor_keeps_a_directional_light_that_nothing_occludes() -> None:
    away = DirectionalLight((0.0, 0.0, -1.0), (0.4, 0.4, 0.4))
    shade = bound(make_world(floor_item(), BOX, lights=(SKY, NOON, away)))
    assert (shade.lost_radiance, shade.remaining_radiance) == pytest.approx((0.25, 0.15))


def test_floor_alone_loses_nothing_until_an_object_comes() -> None:
    world = make_world(floor_item(), lights=(SKY, NOON))
    assert bound(world) == NO_SHADOW_LOSS
    # White, facing the directional light, in the dimmer half of the sky.
    shade = bound(world, DynamicObject(MESH, Pose.identity()))
    assert (shade.lost_radiance, shade.remaining_radiance) == pytest.approx(
        (0.5 / 0.7, 0.2 / 0.7)
    ) or (
        shade.lost_radiance,
        shade.remaining_radiance,
    ) == pytest.approx((0.5, 0.2))


def test_object_near_a_point_light_may_lose_more_than_the_floor() -> None:
    point_light = PointLight((0.0, 0.0, -2.0), (0.1, 0.1, 0.1))
    world = make_world(floor_item(), lights=(SKY, point_light))
    far, near = (bound(world, DynamicObject(MESH, Pose.from_rpy((0, 0, -z)))) for z in (0.2, 1.5))
    assert near.lost_radiance > 2.0 * far.lost_radiance


def test_world_with_a_hemisphere_light_alone_loses_nothing() -> None:
    assert (
        bound(make_world(floor_item(), BOX, lights=(SKY,)), DynamicObject(MESH, Pose.identity()))
        == NO_SHADOW_LOSS
    )


def test_hidden_sky_makes_a_shadow_more_visible() -> None:
    world = make_box_world(lights=(SKY, NOON))
    hidden = bake_scene(world)
    whole = ShadowBounds(build_scene(world), world).darkest_shadow(())
    dim = ShadowBounds(hidden, world).darkest_shadow(())
    assert grey_level_change(dim) > grey_level_change(whole)
