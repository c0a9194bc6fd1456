"""The table of sRGB greys against the formula in float64."""

from __future__ import annotations

import numpy as np

from catoptra_server.render.image_changer import MAX_LEVEL, encode_srgb, srgb_table
from catoptra_server.world.world_description import srgb_from_linear


def test_encode_srgb_is_within_a_tenth_of_a_level_of_float64() -> None:
    light = np.linspace(-0.2, 1.4, 20001, dtype=np.float32)
    exact = 255.0 * srgb_from_linear(light.astype(np.float64))
    assert np.abs(encode_srgb(light) - exact).max() < 0.5 + 0.1


def test_encode_srgb_of_an_image_keeps_its_shape() -> None:
    assert encode_srgb(np.ones((2, 5, 3), dtype=np.float32)).shape == (2, 5, 3)


def test_table_rises_from_black_to_white_and_is_shared() -> None:
    table = srgb_table()
    assert len(table) == MAX_LEVEL + 1
    assert (table[0], table[-1]) == (0, 255)
    assert (np.diff(table.astype(np.int64)) >= 0).all()
    assert set(table) == set(range(256))
    assert table is srgb_table()
    assert not table.flags.writeable


def test_light_that_is_no_number_is_black() -> None:
    light = np.array([np.nan, -np.inf, np.inf], dtype=np.float32)
    assert encode_srgb(light).tolist() == [0, 0, 255]
