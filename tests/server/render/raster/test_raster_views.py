from __future__ import annotations

import threading

import numpy as np

from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.scene_mesh import build_scene
from helpers.effect_measurement import CAMERA, make_effect
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world


def make_renderer(device: GlDevice) -> RasterRenderer:
    world = make_test_world()
    return RasterRenderer(build_scene(world), world, device=device)


def test_linear_image_when_read_is_the_encoded_one(device: GlDevice) -> None:
    effects = (make_effect("Vignetting"),)
    view = make_renderer(device).prepare(CAMERA, make_plan(CAMERA))
    light, rgb = view.render_linear(CAMERA_STATE, effects), view.render(CAMERA_STATE, effects).rgb
    assert (light.dtype, light.shape) == (np.float32, rgb.shape)
    # Half a level is rounding, the rest the shader's square roots.
    assert np.abs(255.0 * srgb_from_linear(light.astype(np.float64)) - rgb).max() < 0.5 + 0.03
    assert np.ptp(rgb) > 100
    view.close()


def test_view_when_rendered_by_another_thread_raises(device: GlDevice) -> None:
    view = make_renderer(device).prepare(CAMERA, make_plan(CAMERA))
    errors: list[str] = []

    def draw() -> None:
        try:
            view.render(CAMERA_STATE)
        except AssertionError as error:
            errors.append(str(error))

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    assert errors == ["a view belongs to its renderer's thread"]
    view.close()
