"""Sky: what its bound covers, and what cameras show without it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import SceneSummary
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.effects.scene.sky_radiance import SkyRadiance
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.world.scene_mesh import build_scene
from helpers.image_comparison import level_differences
from helpers.opengl import device_or_skip
from helpers.trace_engines import ENGINES, EngineName, open_engine
from helpers.trace_kernels import make_omni_table
from helpers.worlds import (
    CAMERA_STATE,
    make_omni_camera,
    make_plan,
    make_smooth_sky,
    make_test_world,
    under_sky,
)

CAMERA = make_omni_camera()
UNDER_NONE = replace(CAMERA_STATE, has_sky=False)


@pytest.mark.parametrize("engine", ENGINES)
def test_sky_when_left_out_is_its_mean_and_changes_no_more_than_bound(engine: EngineName) -> None:
    world = under_sky(make_test_world(), make_smooth_sky())
    summary = SceneSummary(1.0, background_radiance=world.background_range)
    bound = SkyRadiance().bound(summary, CAMERA).value
    with open_engine(engine, world) as opened:
        rays = opened.prepare(make_omni_table(width_px=64))
        with_sky, without = map(rays.render_linear, (CAMERA_STATE, UNDER_NONE))
    with open_engine(engine, replace(world, sky=None)) as opened:
        plain = opened.prepare(make_omni_table(width_px=64)).render_linear(CAMERA_STATE)
    np.testing.assert_array_equal(without, plain)
    change = find_changes(with_sky, without, (1.0, 1.0)).max()
    assert 1.0 < change <= bound


def test_raster_shows_the_mean_where_the_sky_is_left_out() -> None:
    world = under_sky(make_test_world(), make_smooth_sky())
    renderers = [
        RasterRenderer(build_scene(one), one, device=device_or_skip())
        for one in (world, replace(world, sky=None))
    ]
    plan = make_plan(CAMERA, face_size_px=128)
    left_out, plain = (
        renderer.prepare(CAMERA, plan).render(UNDER_NONE).rgb for renderer in renderers
    )
    assert level_differences(left_out, plain).max() == 0


def test_background_of_one_colour_is_proved_off() -> None:
    grey = (0.2, 0.3, 0.4)
    assert (
        SkyRadiance().bound(SceneSummary(1.0, background_radiance=(grey, grey)), CAMERA).value
        == 0.0
    )
    assert SkyRadiance().bound(SceneSummary(1.0), CAMERA).value == 255.0
