"""Texels with their border."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.render.trace.kernel.scene_arrays import MAX_TEXEL, pad_texels

RNG = np.random.default_rng(3)


def test_texels_inside_are_the_linear_light() -> None:
    linear = RNG.uniform(size=(5, 7, 3)).astype(np.float32)
    texels = pad_texels(linear)
    assert texels.shape == (7, 9, 4)
    assert texels.dtype == np.uint16
    # Half a step: a 40th of a grey level where the sRGB curve is steepest.
    np.testing.assert_allclose(texels[1:-1, 1:-1, :3], MAX_TEXEL * linear, atol=0.51)
    assert not texels[..., 3].any()
    assert texels.flags.c_contiguous


@pytest.mark.parametrize("shape", [(5, 7), (1, 1), (1, 4), (6, 1), (2, 2)])
def test_border_repeats_the_opposite_side(shape: tuple[int, int]) -> None:
    linear = RNG.uniform(size=(*shape, 3)).astype(np.float32)
    inner = pad_texels(linear)[1:-1, 1:-1]
    np.testing.assert_array_equal(
        pad_texels(linear), np.pad(inner, ((1, 1), (1, 1), (0, 0)), mode="wrap")
    )
