"""Radiance in packed integers: sums do not spill over, and encode as float64 does."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.render.trace.packed_light import LinearScale, SrgbScale, encode_srgb
from catoptra_server.scene.colour import srgb_from_linear


def unpack_pixels(radiance: np.ndarray, samples: int) -> np.ndarray:
    """(n, 3) colours of (3, n * samples) radiance."""
    scale = SrgbScale.for_samples(samples)
    return scale.unpack(scale.sum_pixels(scale.pack(radiance.astype(np.float32))))


@pytest.mark.parametrize("samples", [1, 4, 9, 16, 25, 256])
def test_pixels_when_averaged_are_those_of_float64(samples: int) -> None:
    radiance = np.random.default_rng(1).uniform(0.0, 1.0, (3, 500 * samples)) ** 3
    mean = radiance.reshape(3, 500, samples).mean(axis=-1)
    expected = 255.0 * srgb_from_linear(mean.T)
    # Half a level is rounding; the rest is the scale's own levels, 0.4 of one at most.
    assert np.abs(unpack_pixels(radiance, samples) - expected).max() <= 0.5 + 0.4


@pytest.mark.parametrize("samples", [1, 4, 256])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_pixels_when_all_samples_are_at_an_end_are_black_or_white(
    samples: int, value: float
) -> None:
    colours = unpack_pixels(np.full((3, 2 * samples), value), samples)
    np.testing.assert_array_equal(colours, round(255 * value))


def test_light_when_outside_the_range_is_clipped_before_it_is_averaged() -> None:
    radiance = np.array([[5.0, 0.0], [-1.0, 0.0], [0.5, 0.5]])
    # Half of full light is level 188, as a sensor that saturates gives it.
    np.testing.assert_array_equal(unpack_pixels(radiance, 2), [[188, 0, 188]])


def test_channels_when_packed_do_not_mix() -> None:
    for channel in range(3):
        radiance = np.zeros((3, 256))
        radiance[channel] = 1.0
        expected = [0, 0, 0]
        expected[channel] = 255
        np.testing.assert_array_equal(unpack_pixels(radiance, 256), [expected])


@pytest.mark.parametrize("samples", [1, 4, 16])
def test_linear_scale_when_light_exceeds_white_keeps_it(samples: int) -> None:
    radiance = np.random.default_rng(1).uniform(0.0, 3.0, (3, 200 * samples)).astype(np.float32)
    scale = LinearScale.for_samples(samples, max_radiance=3.0)
    light = scale.unpack(scale.sum_pixels(scale.pack(radiance)))
    mean = radiance.reshape(3, 200, samples).mean(axis=-1).T
    assert light.dtype == np.float32
    # Half a level of the scale, and float32.
    assert np.abs(light - mean).max() <= 0.5 * 3.0 / scale.max_level + 1e-6


def test_encode_srgb_is_within_a_tenth_of_a_level_of_float64() -> None:
    light = np.linspace(-0.2, 1.4, 20001, dtype=np.float32)
    exact = 255.0 * srgb_from_linear(light.astype(np.float64))
    assert np.abs(encode_srgb(light) - exact).max() < 0.5 + 0.1
