"""Means in linear light, images read back, and long exposures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.passes import (
    LINEAR_DTYPE,
    AveragePass,
    LinearImageTarget,
    OutputImage,
)
from catoptra_server.render.renderer import sample_shutter
from catoptra_server.world.objects import CameraState, Shutter
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, DRIVING_STATE, make_effect
from helpers.opengl import make_raster
from helpers.worlds import make_plan

WIDTH, HEIGHT = 5, 3  # an odd width: rows of 15 bytes have no alignment
EXPOSURE = CameraState(Pose.identity())


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_average_is_taken_in_linear_light_and_encoded(device: GlDevice, samples: int) -> None:
    context = device.context
    size = (samples * WIDTH, samples * HEIGHT)
    light = np.random.default_rng(0).uniform(0.0, 1.0, (size[1], size[0], 4)).astype(np.float16)
    image = context.texture(size, 4, light.tobytes(), dtype=LINEAR_DTYPE)
    output = OutputImage(context, WIDTH, HEIGHT)
    AveragePass(context, ShaderPrograms(context), image, samples, output.target).draw(EXPOSURE)
    blocks = light.astype(np.float64).reshape(HEIGHT, samples, WIDTH, samples, 4)
    expected = 255.0 * srgb_from_linear(blocks.mean(axis=(1, 3))[..., :3])
    assert np.abs(output.read() - expected).max() < 0.52  # half a level and the shader's pow


def test_light_beyond_white_counts_in_the_average(device: GlDevice) -> None:
    context = device.context
    light = np.zeros((2, 2, 4), dtype=np.float16)
    light[0, 0] = 4.0
    image = context.texture((2, 2), 4, light.tobytes(), dtype=LINEAR_DTYPE)
    output = OutputImage(context, 1, 1)
    AveragePass(context, ShaderPrograms(context), image, 2, output.target).draw(EXPOSURE)
    assert output.read().tolist() == [[[255, 255, 255]]]


def test_image_when_read_is_a_read_only_copy(device: GlDevice) -> None:
    output = OutputImage(device.context, WIDTH, HEIGHT)
    output.target.clear(1.0, 0.0, 0.0)
    red = output.read()
    output.target.clear(0.0, 1.0, 0.0)
    assert red.shape == (HEIGHT, WIDTH, 3)
    assert (red == (255, 0, 0)).all()
    assert not red.flags.writeable
    output.close()


def test_row_zero_of_the_target_is_the_top_of_the_image(device: GlDevice) -> None:
    output = OutputImage(device.context, WIDTH, HEIGHT)
    output.target.clear()
    output.target.clear(1.0, 1.0, 1.0, viewport=(0, 0, WIDTH, 1))
    assert output.read()[:, 0, 0].tolist() == [255, 0, 0]
    assert device.context.error == "GL_NO_ERROR"


def test_image_when_read_back_has_its_rows_and_its_light_beyond_white(device: GlDevice) -> None:
    light = np.random.default_rng(7).uniform(0.0, 3.0, (5, 7, 4)).astype(np.float32)
    with device.context as context:
        image = LinearImageTarget(context, 7, 5)
        image.texture.write(light.tobytes())
        np.testing.assert_array_equal(image.read(), light[..., :3])
        assert image.memory_bytes == light.nbytes
        image.close()


LASTING = replace(DRIVING_STATE, shutter=Shutter(0.04, 0.03, 5))


def mean_of_time_samples(
    view: object, camera_state: CameraState
) -> np.ndarray[tuple[int, int, int]]:
    rendered = (
        view.render_linear(sharp_state).astype(np.float64) * weights[:, None, None]  # type: ignore[attr-defined]
        for sharp_state, weights in sample_shutter(camera_state, CAMERA.height_px)
    )
    return sum(rendered, start=np.zeros((CAMERA.height_px, CAMERA.width_px, 3)))


def test_long_exposure_is_the_mean_of_its_time_samples_by_row(device: GlDevice) -> None:
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA))
    np.testing.assert_allclose(
        view.render_linear(LASTING), mean_of_time_samples(view, LASTING), atol=1e-6
    )
    view.close()


def test_rows_that_show_one_time_sample_each_are_those_of_sharp_images(device: GlDevice) -> None:
    # No exposure, so every row has one sample; the effects behind still change the whole image.
    rolling = replace(DRIVING_STATE, shutter=Shutter(0.0, 0.05, 7))
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA))
    for _ in range(2):  # nothing of a frame limits the next one
        np.testing.assert_array_equal(
            view.render_linear(rolling), mean_of_time_samples(view, rolling).astype(np.float32)
        )
    darker = make_effect("Exposure", {"exposure_s": 0.01})
    np.testing.assert_allclose(
        view.render_linear(rolling, (darker,)), darker.gain * view.render_linear(rolling), rtol=1e-5
    )
    view.close()


def test_view_of_a_long_exposure_has_one_stage_for_it_and_none_otherwise(device: GlDevice) -> None:
    renderer = make_raster(device)
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
