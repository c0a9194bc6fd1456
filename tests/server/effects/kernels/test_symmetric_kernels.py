from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.kernels.convolution import (
    convolve_symmetric,
    convolve_symmetric_within,
    num_offset_pairs,
    offset_pairs,
    pair_multiplicities,
)

RNG = np.random.default_rng(3)
LIGHT = RNG.uniform(0.0, 1.0, (45, 37, 3))  # more than one strip of rows
HALF_WIDTH_PX = 2


def random_weights(half_width_px: int) -> Floats:
    """Weights that differ in every pair and sum to 1 over all pixels."""
    weights = RNG.uniform(0.1, 1.0, num_offset_pairs(half_width_px))
    return weights / (weights @ pair_multiplicities(half_width_px))


def full_kernel(weights: Floats, half_width_px: int) -> Floats:
    side = range(-half_width_px, half_width_px + 1)
    index = {pair: number for number, pair in enumerate(offset_pairs(half_width_px))}
    return np.array(
        [[weights[index[max(abs(x), abs(y)), min(abs(x), abs(y))]] for x in side] for y in side]
    )


def convolve_directly(image: Floats, kernel: Floats) -> Floats:
    half_width = len(kernel) // 2
    padded = np.pad(image, ((half_width, half_width), (half_width, half_width), (0, 0)), "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, kernel.shape, axis=(0, 1))
    return np.einsum("hwcyx,yx->hwc", windows, kernel)


def test_pairs_when_counted_have_an_index_and_a_size_each() -> None:
    assert [i * (i + 1) // 2 + j for i, j in offset_pairs(3)] == list(range(num_offset_pairs(3)))
    assert pair_multiplicities(3).sum() == 7 * 7


@pytest.mark.parametrize("half_width", [0, 1, 2, 5])
def test_image_when_convolved_equals_the_plain_sum(half_width: int) -> None:
    weights = random_weights(half_width)
    expected = convolve_directly(LIGHT, full_kernel(weights, half_width))
    got = convolve_symmetric(LIGHT, half_width, lambda rows: weights[:, None, None, None])
    np.testing.assert_allclose(got, expected, rtol=1e-13)


def test_weights_when_they_differ_from_pixel_to_pixel_are_each_pixels_own() -> None:
    one, other = random_weights(HALF_WIDTH_PX), random_weights(HALF_WIDTH_PX)
    fraction = RNG.uniform(0.0, 1.0, LIGHT.shape[:2])
    mixed = one[:, None, None] + fraction * (other - one)[:, None, None]
    images = [convolve_directly(LIGHT, full_kernel(each, HALF_WIDTH_PX)) for each in (one, other)]
    expected = images[0] + fraction[..., None] * (images[1] - images[0])
    got = convolve_symmetric(LIGHT, HALF_WIDTH_PX, lambda rows: mixed[:, rows])
    np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_region_when_it_is_even_stays_even_and_outside_nothing_changes() -> None:
    inside = np.zeros(LIGHT.shape[:2], dtype=bool)
    inside[5:30, 8:20] = True
    light = np.where(inside[..., None], 0.7, LIGHT)
    weights = random_weights(HALF_WIDTH_PX)
    got = convolve_symmetric_within(
        light, inside, HALF_WIDTH_PX, lambda rows: weights[:, None, None, None]
    )
    np.testing.assert_allclose(got, light, rtol=1e-14)


def test_region_when_it_is_everything_is_convolved_as_without_one() -> None:
    weights = random_weights(HALF_WIDTH_PX)
    everything = np.ones(LIGHT.shape[:2], dtype=bool)
    got = convolve_symmetric_within(
        LIGHT, everything, HALF_WIDTH_PX, lambda rows: weights[:, None, None, None]
    )
    expected = convolve_symmetric(LIGHT, HALF_WIDTH_PX, lambda rows: weights[:, None, None, None])
    np.testing.assert_allclose(got, expected, rtol=1e-13)
