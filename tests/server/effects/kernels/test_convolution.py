"""Convolutions are the plain sums; kernels of discs have the variance and the light of discs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.kernels.convolution import (
    MAX_DIAMETER_PX,
    convolve_symmetric,
    convolve_symmetric_within,
    disc_kernel_table,
    float32_weights,
    offset_pairs,
    pair_multiplicities,
    table_row,
)

RNG = np.random.default_rng(3)
LIGHT = RNG.uniform(0.0, 1.0, (45, 37, 3))  # more than one strip of rows
HALF_WIDTH_PX = 2


def random_weights(half_width_px: int) -> Floats:
    """Weights that differ in every pair and sum to 1 over all pixels."""
    weights = RNG.uniform(0.1, 1.0, len(pair_multiplicities(half_width_px)))
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
    assert [i * (i + 1) // 2 + j for i, j in offset_pairs(3)] == list(range(10))
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


# Between rows of the table, on rows, and where kernels begin to reach another pixel.
DIAMETERS = [0.0, 0.05, 0.5, 1.0, math.sqrt(2.0), 1.7, 2.0, 3.3, 5.0, 8.0]


def disc_kernel(diameter_px: float, max_diameter_px: float = 8.0) -> tuple[Floats, int]:
    table = disc_kernel_table(max_diameter_px)
    row = table_row(np.array([diameter_px]))
    return table.interpolate(row, table.half_width_px)[:, 0], table.half_width_px


@pytest.mark.parametrize("diameter_px", DIAMETERS)
def test_kernel_of_a_disc_has_its_variance_all_its_light_and_no_negative_weight(
    diameter_px: float,
) -> None:
    weights, half_width = disc_kernel(diameter_px)
    along = np.array(
        [0.5 * (i * i + j * j) for i, j in offset_pairs(half_width)]
    ) * pair_multiplicities(half_width)
    assert weights @ pair_multiplicities(half_width) == pytest.approx(1.0, abs=1e-13)
    assert 4.0 * math.sqrt(weights @ along) == pytest.approx(diameter_px, abs=1e-7)
    assert weights.min() >= 0.0


def test_sharp_point_when_convolved_stays_as_it_is() -> None:
    weights, _ = disc_kernel(0.0)
    assert weights[0] == 1.0
    assert not weights[1:].any()


def test_fractions_of_a_discs_area_are_those_counted_on_a_fine_grid() -> None:
    half_width, fine = 3, 400
    at = (np.arange((2 * half_width + 1) * fine) + 0.5) / fine - half_width - 0.5
    for diameter in (1.0, 2.3, 5.1):
        disc = np.hypot(at[:, None], at) <= 0.5 * diameter
        counted = disc.reshape(2 * half_width + 1, fine, 2 * half_width + 1, fine).mean(axis=(1, 3))
        counted /= 0.25 * math.pi * diameter**2
        # The disc of the table with the variance of this one: its squares add some of their own.
        offset = np.arange(-half_width, half_width + 1)
        intended = 4.0 * math.sqrt(float(counted.sum(axis=0) @ np.square(offset)))
        weights, reach = disc_kernel(intended)
        for weight, (i, j) in zip(weights, offset_pairs(reach), strict=True):
            fraction = counted[half_width + j, half_width + i] if i <= half_width else 0.0
            assert weight == pytest.approx(fraction, abs=3e-4)


def test_wide_disc_when_its_kernel_is_made_is_even_within_and_nothing_outside() -> None:
    weights, half_width = disc_kernel(8.0)
    shares = dict(zip(offset_pairs(half_width), weights, strict=True))
    assert shares[0, 0] == shares[2, 1] == pytest.approx(1.0 / (0.25 * math.pi * 64.0), rel=0.05)
    assert shares[4, 4] == 0.0


def test_half_width_when_only_narrow_discs_are_used_is_theirs() -> None:
    table = disc_kernel_table(8.0)
    assert table.half_width_px == 4
    assert table.half_width_up_to_row(float(table_row(np.array(1.5)))) == 1
    row = table_row(np.array([1.5]))
    np.testing.assert_array_equal(table.interpolate(row, 1), table.interpolate(row, 4)[:3])


def test_row_when_beyond_the_table_is_its_last() -> None:
    table = disc_kernel_table(2.0)
    last = np.array([len(table.weights) - 1.0])
    np.testing.assert_array_equal(
        table.interpolate(last + 7.0, table.half_width_px),
        table.interpolate(last, table.half_width_px),
    )


def test_kernels_differ_by_at_most_their_rows_times_the_largest_step() -> None:
    table = disc_kernel_table(3.0)
    counts = pair_multiplicities(table.half_width_px)
    for one, other in RNG.uniform(0.0, len(table.weights) - 1.0, (50, 2)):
        first, second = table.interpolate(np.array([one, other]), table.half_width_px).T
        exchanged = 0.5 * np.abs(first - second) @ counts
        assert exchanged <= table.max_step * abs(one - other) + 1e-12


def test_texture_when_computed_twice_is_the_same_array() -> None:
    table = disc_kernel_table(3.0)
    assert float32_weights(table) is float32_weights(table)
    np.testing.assert_array_equal(float32_weights(table), table.weights.astype(np.float32))


def test_table_of_a_disc_wider_than_any_drawn_takes_no_more_memory() -> None:
    # F/0.7 on pixels of 0.1 um has discs of thousands of pixels: the table grows with d^4.
    widest = disc_kernel_table(MAX_DIAMETER_PX)
    assert disc_kernel_table(5000.0).weights.nbytes == widest.weights.nbytes < 2**23
    row = table_row(np.array(5000.0))
    np.testing.assert_array_equal(
        disc_kernel_table(5000.0).interpolate(row, widest.half_width_px), widest.weights[-1]
    )
