from __future__ import annotations

import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.effects.scene_summary import NO_SHADE, Shade
from catoptra_server.render.shadow_bounds import ShadowBounds
from catoptra_server.scene.bodies import Body, body_mesh
from catoptra_server.scene.description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
)
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.primitives import box
from helpers.shadows import GREY, box_at, floor, world_of

SKY = HemisphereLight((0.3, 0.3, 0.3), (0.2, 0.2, 0.2))
NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
MESH = body_mesh([(box(Box((0.2, 0.2, 0.2))), GREY)])
BOX = box_at(0.0, 0.0, -0.2, (0.2, 0.2, 0.2))


def bound(world: World, *bodies: Body) -> Shade:
    return ShadowBounds(build_scene(world), world).of(bodies)


def test_floor_when_a_box_stands_on_it_loses_the_sun_and_keeps_the_sky() -> None:
    shade = bound(world_of(floor(), BOX, lights=(SKY, NOON)))
    assert shade.lost == pytest.approx(0.5 * 0.5)
    assert shade.left == pytest.approx(0.5 * 0.3)


def test_floor_when_a_second_sun_shines_past_all_things_keeps_it() -> None:
    away = DirectionalLight((0.0, 0.0, -1.0), (0.4, 0.4, 0.4))
    shade = bound(world_of(floor(), BOX, lights=(SKY, NOON, away)))
    assert (shade.lost, shade.left) == pytest.approx((0.25, 0.15))


def test_floor_when_alone_loses_nothing_until_a_body_comes() -> None:
    world = world_of(floor(), lights=(SKY, NOON))
    assert bound(world) == NO_SHADE
    # White, turned towards the sun, in the dimmer half of the sky.
    shade = bound(world, Body(MESH, Pose.identity()))
    assert (shade.lost, shade.left) == pytest.approx((0.5 / 0.7, 0.2 / 0.7)) or (
        shade.lost,
        shade.left,
    ) == pytest.approx((0.5, 0.2))


def test_body_when_near_a_lamp_may_lose_more_than_the_floor() -> None:
    lamp = PointLight((0.0, 0.0, -2.0), (0.1, 0.1, 0.1))
    world = world_of(floor(), lights=(SKY, lamp))
    far, near = (bound(world, Body(MESH, Pose.from_rpy((0, 0, -z)))) for z in (0.2, 1.5))
    assert near.lost > 2.0 * far.lost


def test_world_when_it_has_a_sky_alone_loses_nothing() -> None:
    assert bound(world_of(floor(), BOX, lights=(SKY,)), Body(MESH, Pose.identity())) == NO_SHADE
