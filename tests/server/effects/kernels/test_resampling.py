from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.kernels.resampling import sample_bilinear, sample_bilinear_at_offset

ROWS, COLUMNS = np.mgrid[:9, :12]
U, V = COLUMNS + 0.5, ROWS + 0.5
LIGHT = np.random.default_rng(1).uniform(0.0, 2.0, (9, 12, 3))
RAMP = np.stack((0.1 * U, 0.2 * V, 0.3 * U - 0.1 * V), axis=-1)


def test_light_at_the_centre_of_a_pixel_is_the_pixels() -> None:
    np.testing.assert_array_equal(sample_bilinear(LIGHT, U, V), LIGHT)


def test_light_half_way_to_the_next_pixel_is_the_mean() -> None:
    between = sample_bilinear(LIGHT, U[:, :-1] + 0.5, V[:, :-1])
    np.testing.assert_allclose(between, 0.5 * (LIGHT[:, :-1] + LIGHT[:, 1:]), rtol=1e-14)


def test_ramp_inside_is_exact() -> None:
    rng = np.random.default_rng(2)
    u, v = rng.uniform(0.5, 11.5, 200), rng.uniform(0.5, 8.5, 200)
    expected = np.stack((0.1 * u, 0.2 * v, 0.3 * u - 0.1 * v), axis=-1)
    np.testing.assert_allclose(sample_bilinear(RAMP, u, v), expected, atol=1e-13)


def test_light_beyond_the_border_is_the_last_pixels() -> None:
    u, v = np.array([-7.0, 0.2, 40.0, 12.0]), np.array([-3.0, 4.5, 40.0, 0.1])
    expected = LIGHT[[0, 4, 8, 0], [0, 0, 11, 11]]
    np.testing.assert_allclose(sample_bilinear(LIGHT, u, v), expected, rtol=1e-14)


def test_offset_when_in_float32_is_as_exact_in_wide_images() -> None:
    wide = np.zeros((1, 4096, 3), dtype=np.float32)
    wide[0, 1::2] = 1.0
    pixel = np.array([4000]), np.array([0])
    offset = np.array([0.1], dtype=np.float32)
    level = np.zeros(1, dtype=np.float32)
    radiance = sample_bilinear_at_offset(wide, *pixel, offset_u_px=offset, offset_v_px=level)
    assert radiance.dtype == np.float32
    assert radiance[0, 0] == pytest.approx(0.1, rel=1e-7)
