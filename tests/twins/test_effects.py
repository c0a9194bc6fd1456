"""Each effect's shader against the float64 reference, on one image."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from catoptra_server.effects.kernels.luminance import mean_luminance
from catoptra_server.effects.kernels.noise import frame_noise_key, normal_variates
from catoptra_server.render.raster.effect_chain import EffectPass
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.luminance_meter import LuminanceMeter
from catoptra_server.render.raster.shader_programs import ShaderPrograms
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    DRIVING_STATE,
    IMAGE_EFFECTS,
    NOISE_SEED,
    RANGES,
    make_effect,
    make_test_pattern,
)

LIGHT = make_test_pattern(2.0).astype(np.float32)


def upload_image(context: moderngl.Context) -> LinearImageTarget:
    image = LinearImageTarget(context, CAMERA.width_px, CAMERA.height_px)
    opaque = np.ones((*LIGHT.shape[:2], 4), dtype=np.float32)
    opaque[..., :3] = LIGHT
    image.texture.write(opaque.tobytes())
    return image


class UploadedRange:
    """Ranges of the references, as a texture."""

    def __init__(self, context: moderngl.Context) -> None:
        size = (CAMERA.width_px, CAMERA.height_px)
        self.texture = context.texture(size, 1, RANGES.tobytes(), dtype="f4")
        self.texture.filter = (moderngl.NEAREST, moderngl.NEAREST)

    def close(self) -> None:
        self.texture.release()


def run_effect(
    context: moderngl.Context, name: str, changes: dict[str, float]
) -> np.ndarray[tuple[int, int, int]]:
    source, target = (
        upload_image(context),
        LinearImageTarget(context, CAMERA.width_px, CAMERA.height_px),
    )
    effect, ranges = make_effect(name, changes), UploadedRange(context)
    step = EffectPass(
        context,
        ShaderPrograms(context),
        effect,
        CAMERA,
        source.texture,
        target.target,
        ranges=ranges if effect.needs_range else None,
    )
    step.draw(DRIVING_STATE)
    read = target.read()
    for made in (step, source, target, ranges):
        made.close()
    return read


# Parameters with which an effect changes the image, where the defaults do not.
CHANGES: dict[str, dict[str, float]] = {
    "Defocus": {"f_number": 1.0, "pixel_pitch_m": 3e-5},
    "DefocusByDepth": {"f_number": 0.8, "pixel_pitch_m": 3e-5},
    "ChromaticAberration": {"red_magnification": 1.013, "blue_magnification": 0.991},
    "Exposure": {"exposure_s": 0.05},
    "MirrorReflectance": {"refractive_index": 2.8, "extinction_coefficient": 3.4},
    "Misalignment": {"x_m": 1e-3, "y_m": -4e-4, "axial_m": 2e-3, "pitch_rad": 1e-3},
    "WhiteBalance": {"red_gain": 1.7, "blue_gain": 0.6},
}


@pytest.mark.parametrize("name", IMAGE_EFFECTS)
def test_shader_equals_the_reference(context: moderngl.Context, name: str) -> None:
    changes = CHANGES.get(name, {})
    reference = make_effect(name, changes).apply(LIGHT.astype(np.float64), CAMERA, CAPTURE_CONTEXT)
    assert np.abs(reference - LIGHT).max() > 1e-4
    difference = np.abs(run_effect(context, name, changes) - reference)
    if name == "Quantisation":  # a value on the border of two codes may round either way
        assert (difference > 1e-5).mean() < 1e-3
        difference = np.minimum(difference, np.abs(difference - 1.0 / 4095.0))
    # Some roundings of float32 at radiances up to 2, multiplied by the gain of auto-exposure.
    assert difference.max() < 3e-6


def test_normal_variates_of_the_shader_are_the_same_bits(context: moderngl.Context) -> None:
    source, target = (
        upload_image(context),
        LinearImageTarget(context, CAMERA.width_px, CAMERA.height_px),
    )
    source.texture.write(np.zeros((*LIGHT.shape[:2], 4), dtype=np.float32).tobytes())
    noise = make_effect("ReadNoise", {"read_noise_e": 1.0, "full_well_e": 1.0})
    step = EffectPass(
        context, ShaderPrograms(context), noise, CAMERA, source.texture, target.target
    )
    step.draw(DRIVING_STATE)
    np.testing.assert_array_equal(
        target.read(), normal_variates(frame_noise_key(NOISE_SEED, "ReadNoise"), *LIGHT.shape[:2])
    )
    for made in (step, source, target):
        made.close()


def test_meter_equals_the_mean(context: moderngl.Context) -> None:
    source = upload_image(context)
    meter = LuminanceMeter(context, ShaderPrograms(context), source.texture)
    assert meter.measure_mean_luminance(CAMERA) == pytest.approx(
        mean_luminance(LIGHT, CAMERA), rel=1e-5
    )
    meter.close()
    source.close()
