"""Texels with their border."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.render.trace.kernel.padded_texels import MAX_TEXEL, pad_texels
from catoptra_server.scene.colour import linear_from_srgb

RNG = np.random.default_rng(3)


def test_texels_inside_are_the_image_s_linear_light() -> None:
    image = RNG.integers(0, 256, (5, 7, 3)).astype(np.uint8)
    texels = pad_texels(image)
    assert texels.shape == (7, 9, 4)
    assert texels.dtype == np.uint16
    # Half a step: a 40th of a grey level where the sRGB curve is steepest.
    expected = MAX_TEXEL * linear_from_srgb(image / 255.0)
    np.testing.assert_allclose(texels[1:-1, 1:-1, :3], expected, atol=0.5)
    assert not texels[..., 3].any()
    assert texels.flags.c_contiguous


@pytest.mark.parametrize("shape", [(5, 7), (1, 1), (1, 4), (6, 1), (2, 2)])
def test_border_repeats_the_opposite_side(shape: tuple[int, int]) -> None:
    image = RNG.integers(0, 256, (*shape, 3)).astype(np.uint8)
    inner = pad_texels(image)[1:-1, 1:-1]
    np.testing.assert_array_equal(
        pad_texels(image), np.pad(inner, ((1, 1), (1, 1), (0, 0)), mode="wrap")
    )
