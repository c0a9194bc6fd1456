from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.shared.symmetric_kernels import (
    gathered,
    gathered_within,
    pair_count,
    pair_sizes,
    pairs,
)

RNG = np.random.default_rng(3)
LIGHT = RNG.uniform(0.0, 1.0, (45, 37, 3))  # more than one strip of rows
REACH = 2


def weights_of(reach: int) -> Floats:
    """Return weights that differ in every pair and sum to 1 over all pixels."""
    weights = RNG.uniform(0.1, 1.0, pair_count(reach))
    return weights / (weights @ pair_sizes(reach))


def full_kernel(weights: Floats, reach: int) -> Floats:
    side = range(-reach, reach + 1)
    index = {pair: number for number, pair in enumerate(pairs(reach))}
    return np.array(
        [[weights[index[max(abs(x), abs(y)), min(abs(x), abs(y))]] for x in side] for y in side]
    )


def gathered_plainly(light: Floats, kernel: Floats) -> Floats:
    reach = len(kernel) // 2
    padded = np.pad(light, ((reach, reach), (reach, reach), (0, 0)), "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, kernel.shape, axis=(0, 1))
    return np.einsum("hwcyx,yx->hwc", windows, kernel)


def test_pairs_when_counted_have_an_index_and_a_size_each() -> None:
    assert [i * (i + 1) // 2 + j for i, j in pairs(3)] == list(range(pair_count(3)))
    assert pair_sizes(3).sum() == 7 * 7


@pytest.mark.parametrize("reach", [0, 1, 2, 5])
def test_picture_when_gathered_equals_the_plain_sum(reach: int) -> None:
    weights = weights_of(reach)
    expected = gathered_plainly(LIGHT, full_kernel(weights, reach))
    got = gathered(LIGHT, reach, lambda rows: weights[:, None, None, None])
    np.testing.assert_allclose(got, expected, rtol=1e-13)


def test_weights_when_they_differ_from_pixel_to_pixel_are_each_pixels_own() -> None:
    one, other = weights_of(REACH), weights_of(REACH)
    share = RNG.uniform(0.0, 1.0, LIGHT.shape[:2])
    mixed = one[:, None, None] + share * (other - one)[:, None, None]
    pictures = [gathered_plainly(LIGHT, full_kernel(each, REACH)) for each in (one, other)]
    expected = pictures[0] + share[..., None] * (pictures[1] - pictures[0])
    got = gathered(LIGHT, REACH, lambda rows: mixed[:, rows])
    np.testing.assert_allclose(got, expected, rtol=1e-12)


def test_region_when_it_is_even_stays_even_and_outside_nothing_changes() -> None:
    inside = np.zeros(LIGHT.shape[:2], dtype=bool)
    inside[5:30, 8:20] = True
    light = np.where(inside[..., None], 0.7, LIGHT)
    weights = weights_of(REACH)
    got = gathered_within(light, inside, REACH, lambda rows: weights[:, None, None, None])
    np.testing.assert_allclose(got, light, rtol=1e-14)


def test_region_when_it_is_everything_gathers_as_without_one() -> None:
    weights = weights_of(REACH)
    everything = np.ones(LIGHT.shape[:2], dtype=bool)
    got = gathered_within(LIGHT, everything, REACH, lambda rows: weights[:, None, None, None])
    expected = gathered(LIGHT, REACH, lambda rows: weights[:, None, None, None])
    np.testing.assert_allclose(got, expected, rtol=1e-13)
