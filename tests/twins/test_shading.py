"""include/point_irradiance.glsl and the texture sampler against the float64 lighting model."""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.scene_batches import upload_texture
from catoptra_server.world import shading
from catoptra_server.world.shading import decode_texels
from catoptra_server.world.textures import build_levels
from catoptra_server.world.world_description import PointLight, linear_from_srgb, srgb_from_linear
from helpers.shaders import evaluate_shader, read_texels

LIGHTS = (PointLight((0.4, -0.5, -1.4), (0.9, 0.7, 0.4)), PointLight((-2.0, 1.0, 0.3), (3, 4, 5)))


def shader_irradiance(context: moderngl.Context, places: Floats, normals: Floats) -> Floats:
    out = evaluate_shader(
        context,
        "point_irradiance.frag",
        include="include/point_irradiance.glsl",
        inputs=(places, normals),
        uniforms={
            "light_positions": [light.position_m for light in LIGHTS],
            "light_intensities": [light.intensity for light in LIGHTS],
        },
        define=(("NUM_POINT_LIGHTS", len(LIGHTS)),),
    )
    return out[:, :3]


def test_point_irradiance_equals_the_model(context: moderngl.Context) -> None:
    rng = np.random.default_rng(3)
    places = rng.uniform(-3.0, 3.0, (4000, 3))
    normals = rng.normal(size=(4000, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    shown = shader_irradiance(context, places, normals)
    expected = shading.point_irradiance(LIGHTS, places, normals)
    # Relative: a dozen float32 operations. Absolute: grazing light, where the cosine cancels.
    np.testing.assert_allclose(shown, expected, rtol=2e-5, atol=2e-6)


def test_point_irradiance_at_the_light_is_finite(context: moderngl.Context) -> None:
    place = np.array([LIGHTS[0].position_m], dtype=np.float64)
    normal = np.array([[0.0, 0.0, 1.0]])
    shown = shader_irradiance(context, place, normal)
    expected = shading.point_irradiance(LIGHTS, place, normal)
    # Float32 puts the point 3e-8 m from the light; by definition it counts as a millimetre.
    np.testing.assert_allclose(shown, expected, rtol=1e-3, atol=50.0)


def test_levels_of_a_texture_are_the_model_s(context: moderngl.Context) -> None:
    image = np.random.default_rng(5).integers(0, 256, (21, 38, 3), dtype=np.uint8)
    texture = upload_texture(context, image)
    levels = [decode_texels(image), *build_levels(image)[1:]]
    sizes = [level.shape[1::-1] for level in levels]
    assert sizes == [(38, 21), (19, 10), (9, 5), (4, 2), (2, 1), (1, 1)]
    for number, level in enumerate(levels):
        expected = np.rint(255.0 * srgb_from_linear(level.astype(np.float64)))
        np.testing.assert_array_equal(read_texels(texture, number, level.shape), expected)


def test_levels_are_rounded_to_the_nearest_byte_on_both_sides_of_every_threshold(
    context: moderngl.Context,
) -> None:
    # Pairs of equal rows keep their light; means of two neighbours lie near all thresholds.
    grey = np.arange(256, dtype=np.uint8)
    image = np.stack((grey, np.roll(grey, 1)), axis=1).reshape(1, 512, 1).repeat(3, axis=2)
    texture = upload_texture(context, image.repeat(2, axis=0))
    for number, level in enumerate(build_levels(image.repeat(2, axis=0))[1:], start=1):
        expected = np.rint(255.0 * srgb_from_linear(level.astype(np.float64)))
        np.testing.assert_array_equal(read_texels(texture, number, level.shape), expected)


def test_texture_is_filtered_in_linear_light_and_repeats(context: moderngl.Context) -> None:
    rng = np.random.default_rng(4)
    image = rng.integers(0, 256, (24, 40, 3), dtype=np.uint8)
    uv = rng.uniform(-2.0, 2.0, (4000, 2)).astype(np.float32).astype(np.float64)
    shown = evaluate_shader(
        context,
        "texture_value.frag",
        include=None,
        inputs=(uv,),
        texture=upload_texture(context, image),
    )
    expected = shading.sample_texture(linear_from_srgb(image / 255.0), uv)
    # OpenGL promises 8 bits for the position between two texels: 1/256 of their difference.
    assert np.abs(shown[:, :3] - expected).max() < 1.5 / 256.0
