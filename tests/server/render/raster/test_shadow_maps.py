"""Depths in shadow maps, and the resources that exist without any shadow caster."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.shadow_maps import ShadowMaps
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shading import shadow_casting_lights
from catoptra_server.world.world_description import DirectionalLight, Light, World
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.opengl import make_raster
from helpers.shadows import (
    DIM_HEMISPHERE_LIGHT,
    DIRECTIONAL_LIGHT,
    POINT_LIGHT,
    box_item,
    floor_item,
    make_world,
)
from helpers.worlds import make_omni_camera, make_plan

WORLD = make_world(
    floor_item(),
    box_item(0.3, 0.1, -0.15, (0.3, 0.2, 0.3)),
    lights=(DIM_HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
)
AT = CameraState(Pose.from_rpy((0.05, 0.03, -1.0)))


def shadow_programs(renderer: RasterRenderer) -> list[str]:
    return [name for name in renderer.program_names if "shadow" in name or "SHADOWS" in name]


def test_camera_states_without_shadows_build_nothing_for_them(device: GlDevice) -> None:
    renderer = make_raster(device, WORLD)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    view.render(AT)
    assert shadow_programs(renderer) == []
    view.render(dataclasses.replace(AT, has_shadows=True))
    assert shadow_programs(renderer) == [
        "shadow",
        "face SHADOWS=1 MAP_COLUMNS=3"
        " NUM_SHADOWED_DIRECTIONAL_LIGHTS=1 NUM_SHADOWED_POINT_LIGHTS=1",
    ]
    view.close()


def test_world_without_shadow_casting_lights_builds_nothing_for_them(device: GlDevice) -> None:
    world = dataclasses.replace(WORLD, lights=(DIM_HEMISPHERE_LIGHT,))
    renderer = make_raster(device, world)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    view.render(dataclasses.replace(AT, has_shadows=True))
    assert shadow_programs(renderer) == []
    view.close()


def make_maps(device: GlDevice, world: World) -> ShadowMaps:
    lights = shadow_casting_lights(world.lights)
    scene = build_scene(world)
    return ShadowMaps(
        device.context, ShaderPrograms(device.context), scene, lights, origin=np.zeros(3)
    )


def test_maps_when_a_program_samples_them_are_defined_by_number(device: GlDevice) -> None:
    with device.context:
        maps = make_maps(device, WORLD)
        assert maps.definitions == (
            ("SHADOWS", 1),
            ("MAP_COLUMNS", 3),
            ("NUM_SHADOWED_DIRECTIONAL_LIGHTS", 1),
            ("NUM_SHADOWED_POINT_LIGHTS", 1),
        )
        assert maps.texture_bytes == 4 * (3 * 1024) ** 2
        maps.draw_objects(TWO_ROBOTS)
        assert maps.texture_bytes == 4 * (3 * 1024) ** 2 + 4 * (3 * 512) ** 2
        maps.close()


@pytest.mark.parametrize(
    "lights",
    [
        (DIRECTIONAL_LIGHT,) * 9,
        (POINT_LIGHT,) * 41,
    ],
    ids=["directional lights", "point lights"],
)
def test_maps_when_lights_are_too_many_are_rejected_by_number(
    device: GlDevice, lights: tuple[Light, ...]
) -> None:
    with pytest.raises(DomainError, match=r"at most 8 directional and 40 point lights.*trace"):
        make_maps(device, dataclasses.replace(WORLD, lights=lights))


def test_lights_when_as_many_as_are_allowed_are_rendered(device: GlDevice) -> None:
    lights = [
        DirectionalLight((0.6 * np.cos(a), 0.6 * np.sin(a), 0.8), (0.05,) * 3)
        for a in np.linspace(0.0, 5.0, 8)
    ]
    point_lights = [dataclasses.replace(POINT_LIGHT, intensity=(0.01,) * 3)] * 40
    world = dataclasses.replace(WORLD, lights=(DIM_HEMISPHERE_LIGHT, *lights, *point_lights))
    renderer = make_raster(device, world)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    lit = view.render(AT).rgb.astype(int)
    shadowed = view.render(dataclasses.replace(AT, has_shadows=True)).rgb
    assert (shadowed <= lit + 1).all()
    assert (lit - shadowed).max() > 10
    view.close()
