from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.luminance import LUMINANCE_WEIGHTS, count_valid_pixels
from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.luminance_meter import LuminanceMeter
from catoptra_server.render.raster.shader_programs import ShaderPrograms
from helpers.effect_measurement import CAMERA


def test_mean_luminance_is_that_of_the_pixels_on_the_mirror(device: GlDevice) -> None:
    size = (CAMERA.height_px, CAMERA.width_px, 4)
    light = np.random.default_rng(7).uniform(0.0, 2.0, size).astype(np.float32)
    with device.context as context:
        image = LinearImageTarget(context, CAMERA.width_px, CAMERA.height_px)
        image.texture.write(light.tobytes())
        meter = LuminanceMeter(context, ShaderPrograms(context), image.texture)
        means = [meter.measure_mean_luminance(CAMERA) for _ in range(2)]
        meter.close()
        image.close()
    total = (light[..., :3].astype(np.float64) @ LUMINANCE_WEIGHTS).sum()
    assert means[0] == pytest.approx(total / count_valid_pixels(CAMERA), rel=1e-5)
    assert means[1] == means[0]
