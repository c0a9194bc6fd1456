from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.cubic import cubic_aside, with_differences
from catoptra_server.effects.image_law import AT_RIM, INNER, WHOLE, image_law
from catoptra_server.effects.image_motion import ImageMotion
from catoptra_server.effects.moved_light import moved_light
from helpers.effects import CAMERA, CAPTURE, card

MOTION = ImageMotion(CAMERA, CAPTURE, np.dtype(np.float64))
STANDING = image_law(CAMERA).standing.reshape(-1)
LIGHT = card()
TABLE = with_differences(LIGHT)


def moved(pixels: np.ndarray, u_px: float, v_px: float) -> np.ndarray:
    aside = np.repeat([[u_px], [v_px]], len(pixels), axis=1)
    return moved_light(TABLE, MOTION, pixels, aside)


def test_light_when_inside_the_mirror_is_the_cubics() -> None:
    pixels = np.flatnonzero(STANDING.reshape(96, 96)[30:60, 30:60] == INNER)
    pixels = (pixels // 30 + 30) * 96 + pixels % 30 + 30
    aside = np.repeat([[0.3], [-1.2]], len(pixels), axis=1)
    expected = cubic_aside(TABLE, pixels, aside, width=CAMERA.width_px)
    np.testing.assert_array_equal(moved(pixels, 0.3, -1.2), expected)


def test_light_when_within_two_pixels_of_the_rim_is_the_next_pixels() -> None:
    pixels = np.flatnonzero(STANDING == WHOLE)
    flat = LIGHT.reshape(-1, 3)
    np.testing.assert_array_equal(moved(pixels, 0.4, -0.4), flat[pixels])


@pytest.mark.parametrize("far_px", [3.0, 40.0, 500.0])
def test_light_when_it_would_come_from_beyond_the_rim_is_the_pixels_own(far_px: float) -> None:
    row = 48 * 96
    pixels = row + np.flatnonzero(STANDING[row : row + 96] == AT_RIM)
    pixels = pixels[pixels % 96 < 48]
    assert pixels.size
    np.testing.assert_array_equal(moved(pixels, -far_px, 0.0), LIGHT.reshape(-1, 3)[pixels])


def test_mirror_when_of_one_light_stays_it_up_to_the_rim() -> None:
    beside = STANDING.reshape(96, 96) < WHOLE
    even = np.where(beside[..., None], 0.0, np.full((96, 96, 3), 0.7))
    pixels = np.flatnonzero(STANDING >= WHOLE)
    rng = np.random.default_rng(1)
    aside = rng.normal(scale=3.0, size=(2, len(pixels)))
    light = moved_light(with_differences(even), MOTION, pixels, aside)
    np.testing.assert_allclose(light, 0.7, rtol=1e-14)
