from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.effects.kernels.light import count_valid_pixels, mean_luminance
from helpers.effect_measurement import CAMERA, make_test_pattern

ON_MIRROR = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA))[1]


def test_mean_of_an_even_image_counts_only_the_mirror() -> None:
    even = np.full((96, 96, 3), 0.3) * ON_MIRROR
    assert mean_luminance(even, CAMERA) == pytest.approx(0.3, rel=1e-12)


@pytest.mark.parametrize(("channel", "weight"), [(0, 0.2126), (1, 0.7152), (2, 0.0722)])
def test_mean_of_one_colour_has_the_weight_of_rec_709(channel: int, weight: float) -> None:
    image = np.zeros((96, 96, 3))
    image[..., channel] = ON_MIRROR[..., 0]
    assert mean_luminance(image, CAMERA) == pytest.approx(weight, rel=1e-12)


def test_count_when_the_image_is_lit_everywhere_covers_all_lit_pixels() -> None:
    lit = make_test_pattern().any(axis=-1)
    assert lit.sum() <= count_valid_pixels(CAMERA)


def test_mean_of_a_float32_image_is_that_of_float64() -> None:
    single = mean_luminance(make_test_pattern().astype(np.float32), CAMERA)
    assert single == pytest.approx(mean_luminance(make_test_pattern(), CAMERA), rel=1e-6)
