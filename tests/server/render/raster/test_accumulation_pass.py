from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import sample_shutter
from catoptra_server.world.camera_state import CameraState, Shutter
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import CAMERA, DRIVING_STATE, make_effect
from helpers.worlds import make_plan, make_test_world

LASTING = replace(DRIVING_STATE, shutter=Shutter(0.04, 0.03, 5))


def make_renderer(device: GlDevice) -> RasterRenderer:
    return RasterRenderer(build_scene(make_test_world()), make_test_world(), device=device)


def mean_of_time_samples(
    view: object, camera_state: CameraState
) -> np.ndarray[tuple[int, int, int]]:
    rendered = (
        view.render_linear(sharp_state).astype(np.float64) * weights[:, None, None]  # type: ignore[attr-defined]
        for sharp_state, weights in sample_shutter(camera_state, CAMERA.height_px)
    )
    return sum(rendered, start=np.zeros((CAMERA.height_px, CAMERA.width_px, 3)))


def test_long_exposure_is_the_mean_of_its_time_samples_by_row(device: GlDevice) -> None:
    view = make_renderer(device).prepare(CAMERA, make_plan(CAMERA))
    np.testing.assert_allclose(
        view.render_linear(LASTING), mean_of_time_samples(view, LASTING), atol=1e-6
    )
    view.close()


def test_rows_that_show_one_time_sample_each_are_those_of_sharp_images(device: GlDevice) -> None:
    # No exposure, so every row has one sample; the effects behind still change the whole image.
    rolling = replace(DRIVING_STATE, shutter=Shutter(0.0, 0.05, 7))
    view = make_renderer(device).prepare(CAMERA, make_plan(CAMERA))
    for _ in range(2):  # nothing of a frame limits the next one
        np.testing.assert_array_equal(
            view.render_linear(rolling), mean_of_time_samples(view, rolling).astype(np.float32)
        )
    darker = make_effect("Exposure", {"exposure_s": 0.01})
    np.testing.assert_allclose(
        view.render_linear(rolling, (darker,)),
        darker.gain * view.render_linear(rolling),
        rtol=1e-5,
    )
    view.close()


def test_view_of_a_long_exposure_has_one_stage_for_it_and_none_otherwise(
    device: GlDevice,
) -> None:
    renderer = make_renderer(device)
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    view.render(DRIVING_STATE)
    assert view.pass_names == ("faces", "mirror")
    assert not [name for name in renderer.program_names if "weighted_accumulate" in name]
    effects = (make_effect("Vignetting"),)
    assert tuple(view.render(LASTING, effects).stage_ms) == (
        "accumulate",
        "readback",
        "Vignetting",
        "encode",
    )
    view.close()
