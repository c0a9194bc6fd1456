from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.warp import warp, warp_map_from_offsets
from helpers.bilinear import sample_bilinear_at_offset

RNG = np.random.default_rng(3)
LIGHT = RNG.uniform(0.0, 2.0, (9, 12, 3))


def test_image_when_nothing_moves_keeps_every_bit() -> None:
    still = warp_map_from_offsets(np.zeros((9, 12, 2), dtype=np.float32))
    np.testing.assert_array_equal(warp(LIGHT, still), LIGHT)


@pytest.mark.parametrize("type_", [np.float32, np.float64])
def test_image_when_moved_by_whole_pixels_keeps_every_bit(type_: type) -> None:
    offset = np.zeros((9, 12, 2), dtype=np.float32)
    offset[...] = (3.0, -2.0)
    image = LIGHT.astype(type_)
    moved = warp(image, warp_map_from_offsets(offset))
    assert moved.dtype == type_
    np.testing.assert_array_equal(moved[2:, :-3], image[:-2, 3:])


def test_image_when_read_anywhere_is_the_resampled_one() -> None:
    offset = RNG.uniform(-15.0, 15.0, (9, 12, 2)).astype(np.float32)
    row, column = np.indices((9, 12))
    u_px, v_px = np.moveaxis(offset.astype(np.float64), -1, 0)
    # Weights are rounded to float32.
    expected = sample_bilinear_at_offset(LIGHT, column, row, offset_u_px=u_px, offset_v_px=v_px)
    np.testing.assert_allclose(warp(LIGHT, warp_map_from_offsets(offset)), expected, atol=2e-7)


def test_image_when_warped_is_left_alone() -> None:
    before = LIGHT.copy()
    warp(LIGHT, warp_map_from_offsets(np.full((9, 12, 2), 0.3, dtype=np.float32)))
    np.testing.assert_array_equal(LIGHT, before)
