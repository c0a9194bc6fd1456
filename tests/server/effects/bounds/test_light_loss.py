"""Losses are judged as an image shows them; lights that nothing shows are culled."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import NO_SHADOW_LOSS, ShadowLoss
from catoptra_server.effects.bounds.light_loss import (
    MAX_CULLED_GREY_LEVELS,
    cull_lights,
    grey_level_change,
    max_visible_loss,
)
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shading import facet_irradiance, point_irradiance
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    Light,
    PointLight,
    srgb_from_linear,
)
from helpers.opengl import device_or_skip
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    GREY,
    POINT_LIGHT,
    floor_item,
    make_world,
)
from helpers.worlds import make_omni_camera, make_plan

BELOW = PointLight((0.0, 0.0, 0.5), (9.0, 9.0, 9.0))
FAR = PointLight((0.0, 0.0, -500.0), (3.0, 3.0, 3.0))
DIM = PointLight((0.0, 0.0, -1.0), (1e-5, 1e-5, 1e-5))
UPWARD = DirectionalLight((0.0, 0.0, -1.0), (1.0, 1.0, 1.0))
OFF = PointLight((0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
AT = CameraState(Pose.from_rpy((0.1, 0.2, -0.6)))


def remaining_lights(*lights: Light) -> tuple[Light, ...]:
    return cull_lights(build_scene(make_world(floor_item())), lights)


@pytest.mark.parametrize("light", [BELOW, FAR, DIM, UPWARD, OFF])
def test_light_without_visible_effect_is_culled_and_logged(
    light: Light, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        assert remaining_lights(DIM_HEMISPHERE_LIGHT, light) == (DIM_HEMISPHERE_LIGHT,)
    assert "is culled: no surface changes by more than" in caplog.text


@pytest.mark.parametrize("light", [DIRECTIONAL_LIGHT, POINT_LIGHT])
def test_light_that_lights_a_surface_stays(light: Light) -> None:
    assert remaining_lights(DIM_HEMISPHERE_LIGHT, light) == (DIM_HEMISPHERE_LIGHT, light)


def test_light_that_only_one_corner_reflects_stays() -> None:
    scene = build_scene(make_world(floor_item()))
    corners = np.zeros((len(scene), 3, 3))
    corners[0, 0] = 0.9
    lights = (DIM_HEMISPHERE_LIGHT, POINT_LIGHT)
    black = replace(scene, albedo=np.zeros((len(scene), 3)))
    assert cull_lights(black, lights) == (DIM_HEMISPHERE_LIGHT,)
    assert cull_lights(replace(black, corner_albedo=corners), lights) == lights


def test_lights_that_are_invisible_alone_but_visible_together_stay() -> None:
    one = PointLight((0.0, 0.0, -1.0), (8e-5, 8e-5, 8e-5))
    many = tuple(PointLight((0.1 * n, 0.0, -1.0), one.intensity) for n in range(20))
    assert remaining_lights(DIM_HEMISPHERE_LIGHT, one) == (DIM_HEMISPHERE_LIGHT,)
    assert len(remaining_lights(DIM_HEMISPHERE_LIGHT, *many)) > 10


def test_image_without_culled_lights_changes_by_less_than_the_limit() -> None:
    world = make_world(floor_item(), lights=(DIM_HEMISPHERE_LIGHT, BELOW, FAR, DIM, OFF))
    whole = build_scene(world)
    assert cull_lights(whole, world.lights) == (DIM_HEMISPHERE_LIGHT,)
    normals, points = np.tile((0.0, 0.0, -1.0), (100, 1)), np.zeros((100, 3))
    points[:, 0] = np.linspace(-2.0, 2.0, 100)
    sky = facet_irradiance(world.lights, normals)
    point = point_irradiance(world.lights, points, normals)
    change = 255.0 * (srgb_from_linear(0.5 * (sky + point)) - srgb_from_linear(0.5 * sky))
    assert 0.0 < change.max() < MAX_CULLED_GREY_LEVELS


def test_raster_builds_no_program_for_culled_point_lights_before_an_object_comes() -> None:
    device = device_or_skip()
    world = make_world(floor_item(), lights=(DIM_HEMISPHERE_LIGHT, BELOW, DIM))
    scene = build_scene(world)
    renderer = RasterRenderer(
        scene, world, device=device, scene_lights=cull_lights(scene, world.lights)
    )
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    view.render(AT)
    assert not any("NUM_POINT_LIGHTS" in name for name in renderer.program_names)
    body = DynamicObject(
        build_object_mesh([(box(Box((0.2, 0.2, 0.2))), GREY)]), Pose.from_rpy((0.5, 0, 0.2))
    )
    view.render(CameraState(AT.world_from_mirror, (body,)))
    assert any("NUM_POINT_LIGHTS=2" in name for name in renderer.program_names)
    view.close()
    device.close()


def rows(*values: float) -> np.ndarray:
    return np.array(values)[:, None] * np.array((1.0, 0.5, 0.25))


def test_equal_losses_are_most_visible_in_the_dark() -> None:
    worst = max_visible_loss(rows(0.2, 0.2), rows(0.5, 0.1), can_be_darker=np.zeros(2, dtype=bool))
    assert worst == ShadowLoss(0.2, 0.1)


def test_loss_beyond_white_counts_as_darkened_by_a_texture() -> None:
    lost, left = rows(2.0), rows(2.0)
    assert grey_level_change(
        max_visible_loss(lost, left, can_be_darker=np.array([False]))
    ) == pytest.approx(255.0 - grey_level(0.5))
    white = max_visible_loss(lost, left, can_be_darker=np.array([True]))
    assert white == ShadowLoss(0.5, 0.5)


def test_loss_without_light_is_none() -> None:
    assert max_visible_loss(rows(0.0), rows(1.0), can_be_darker=np.array([True])) == NO_SHADOW_LOSS
    none = np.zeros((0, 3))
    assert max_visible_loss(none, none, can_be_darker=np.zeros(0, dtype=bool)) == NO_SHADOW_LOSS
