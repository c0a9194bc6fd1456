from __future__ import annotations

import logging

import numpy as np
import pytest

from catoptra_protocol.optics.frames import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.reaching_lights import NOTICED, reaching_lights
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene.bodies import Body, body_mesh
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.description import Box, DirectionalLight, Light, PointLight
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.primitives import box
from helpers.opengl import device_or_skip
from helpers.shadows import DUSK, GREY, LAMP, SUN, floor, world_of
from helpers.worlds import omni_camera, raster_plan

BELOW = PointLight((0.0, 0.0, 0.5), (9.0, 9.0, 9.0))
FAR = PointLight((0.0, 0.0, -500.0), (3.0, 3.0, 3.0))
DIM = PointLight((0.0, 0.0, -1.0), (1e-5, 1e-5, 1e-5))
UPWARD = DirectionalLight((0.0, 0.0, -1.0), (1.0, 1.0, 1.0))
OFF = PointLight((0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
AT = Exposure(Pose.from_rpy((0.1, 0.2, -0.6)))


def kept(*lights: Light) -> tuple[Light, ...]:
    return reaching_lights(build_scene(world_of(floor())), lights)


@pytest.mark.parametrize("light", [BELOW, FAR, DIM, UPWARD, OFF])
def test_light_when_no_surface_would_miss_it_is_left_out_and_the_log_says_why(
    light: Light, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        assert kept(DUSK, light) == (DUSK,)
    assert "is left out: it changes no surface by more than" in caplog.text


@pytest.mark.parametrize("light", [SUN, LAMP])
def test_light_when_a_surface_is_lit_by_it_stays(light: Light) -> None:
    assert kept(DUSK, light) == (DUSK, light)


def test_lights_when_dim_one_by_one_stay_where_all_together_are_noticed() -> None:
    one = PointLight((0.0, 0.0, -1.0), (8e-5, 8e-5, 8e-5))
    many = tuple(PointLight((0.1 * n, 0.0, -1.0), one.intensity) for n in range(20))
    assert kept(DUSK, one) == (DUSK,)
    assert len(kept(DUSK, *many)) > 10


def test_picture_when_lights_are_left_out_changes_by_less_than_is_noticed() -> None:
    world = world_of(floor(), lights=(DUSK, BELOW, FAR, DIM, OFF))
    whole = build_scene(world)
    assert reaching_lights(whole, world.lights) == (DUSK,)
    normals, points = np.tile((0.0, 0.0, -1.0), (100, 1)), np.zeros((100, 3))
    points[:, 0] = np.linspace(-2.0, 2.0, 100)
    from catoptra_server.render import shading

    sky = shading.facet_irradiance(world.lights, normals)
    lamps = shading.point_irradiance(world.lights, points, normals)
    change = 255.0 * (srgb_from_linear(0.5 * (sky + lamps)) - srgb_from_linear(0.5 * sky))
    assert 0.0 < change.max() < NOTICED


def test_raster_when_lamps_reach_nothing_builds_no_program_for_them_until_a_body_comes() -> None:
    device = device_or_skip()
    world = world_of(floor(), lights=(DUSK, BELOW, DIM))
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare(omni_camera(), raster_plan(omni_camera()))
    view.draw(AT)
    assert not any("POINT_LIGHTS" in name for name in renderer.programs_built)
    body = Body(body_mesh([(box(Box((0.2, 0.2, 0.2))), GREY)]), Pose.from_rpy((0.5, 0, 0.2)))
    view.draw(Exposure(AT.world_from_mirror, (body,)))
    assert any("POINT_LIGHTS=2" in name for name in renderer.programs_built)
    view.close()
    device.close()


def test_trace_when_lamps_reach_nothing_computes_no_light_by_place() -> None:
    world = world_of(floor(), lights=(DUSK, BELOW, FAR))
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    assert not renderer.light_varies
    renderer.close()
