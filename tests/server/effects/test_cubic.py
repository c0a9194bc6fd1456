from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.cubic import cubic_aside, with_differences

HEIGHT, WIDTH = 9, 11
ROWS, COLUMNS = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
PIXELS = np.array([3 * WIDTH + 4, 4 * WIDTH + 5, 5 * WIDTH + 6])


def read(light: np.ndarray, aside: np.ndarray) -> np.ndarray:
    return cubic_aside(with_differences(light), PIXELS, aside, width=WIDTH)


def test_light_at_the_middle_of_a_pixel_is_the_pixels() -> None:
    light = np.random.default_rng(1).uniform(0.0, 2.0, (HEIGHT, WIDTH, 3))
    np.testing.assert_array_equal(read(light, np.zeros((2, 3))), light.reshape(-1, 3)[PIXELS])


def test_light_a_whole_pixel_aside_is_that_pixels() -> None:
    light = np.random.default_rng(1).uniform(0.0, 2.0, (HEIGHT, WIDTH, 3))
    aside = np.array([[1.0, -2.0, 0.0], [0.0, 1.0, -3.0]])
    expected = light.reshape(-1, 3)[PIXELS + np.array([1, WIDTH - 2, -3 * WIDTH])]
    np.testing.assert_allclose(read(light, aside), expected, rtol=1e-14)


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_quadratic_when_read_between_pixels_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(6, 3))

    def surface(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        powers = np.stack((np.ones_like(u), u, v, u * v, u * u, v * v), axis=-1)
        return powers @ a

    aside = rng.uniform(-1.0, 1.0, (2, 3))
    u, v = PIXELS % WIDTH + aside[0], PIXELS // WIDTH + aside[1]
    np.testing.assert_allclose(read(surface(COLUMNS, ROWS), aside), surface(u, v), atol=1e-11)


def test_line_when_read_along_one_axis_is_catmull_and_roms_cubic() -> None:
    light = np.random.default_rng(5).uniform(0.0, 1.0, (HEIGHT, WIDTH, 3))
    f = 0.3
    weights = np.array(
        [-f * (1 - f) ** 2, 2 - 5 * f**2 + 3 * f**3, f + 4 * f**2 - 3 * f**3, -(f**2) * (1 - f)]
    )
    flat = light.reshape(-1, 3)
    expected = sum(0.5 * w * flat[PIXELS + k] for k, w in zip((-1, 0, 1, 2), weights, strict=True))
    aside = np.array([[f] * 3, [0.0] * 3])
    np.testing.assert_allclose(read(light, aside), expected, rtol=1e-13)


def test_float32_stays_float32() -> None:
    light = np.ones((HEIGHT, WIDTH, 3), dtype=np.float32)
    assert read(light, np.zeros((2, 3), dtype=np.float32)).dtype == np.float32
