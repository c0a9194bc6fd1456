"""Effects by their own formulas, and the table of sRGB greys against float64."""

from __future__ import annotations

import numpy as np

from catoptra_server.effects import Threshold
from catoptra_server.effects.kernels.grey_levels import measure_change
from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.render.image_changer import (
    ExposedImage,
    NumpyImageChanger,
    encode_srgb,
    srgb_table,
)
from catoptra_server.world.world_description import srgb_from_linear
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, make_test_pattern

PATTERN = make_test_pattern().astype(np.float32)
EXPOSED = ExposedImage(PATTERN, CAMERA, CAPTURE_CONTEXT)


def test_effects_are_applied_in_their_order_and_measured_where_asked() -> None:
    effects = (Vignetting(), Exposure(0.02, 0.01))
    changed = NumpyImageChanger().change(EXPOSED, effects, {"Exposure": Threshold(0.5)})
    between = effects[0].apply(PATTERN, CAMERA, CAPTURE_CONTEXT)
    expected = effects[1].apply(between, CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_array_equal(changed.image, expected)
    assert changed.changes == {"Exposure": measure_change(between, expected)}
    assert list(changed.stage_ms) == ["Vignetting", "Exposure"]


def test_encoding_is_a_stage_behind_all_effects() -> None:
    encoded = NumpyImageChanger().encode(EXPOSED, (Vignetting(),), {})
    expected = encode_srgb(Vignetting().apply(PATTERN, CAMERA, CAPTURE_CONTEXT))
    np.testing.assert_array_equal(encoded.image, expected)
    assert not encoded.image.flags.writeable
    assert list(encoded.stage_ms) == ["Vignetting", "encode"]
    assert encoded.changes == {}


def test_encode_srgb_is_within_a_tenth_of_a_level_of_float64() -> None:
    light = np.linspace(-0.2, 1.4, 20001, dtype=np.float32)
    exact = 255.0 * srgb_from_linear(light.astype(np.float64))
    assert np.abs(encode_srgb(light) - exact).max() < 0.5 + 0.1


def test_encode_srgb_of_an_image_keeps_its_shape() -> None:
    assert encode_srgb(np.ones((2, 5, 3), dtype=np.float32)).shape == (2, 5, 3)


def test_table_rises_from_black_to_white_and_is_shared() -> None:
    table = srgb_table()
    assert len(table) == 2**16
    assert (table[0], table[-1]) == (0, 255)
    assert (np.diff(table.astype(np.int64)) >= 0).all()
    assert set(table) == set(range(256))
    assert table is srgb_table()
    assert not table.flags.writeable


def test_light_that_is_no_number_is_black() -> None:
    light = np.array([np.nan, -np.inf, np.inf], dtype=np.float32)
    assert encode_srgb(light).tolist() == [0, 0, 255]
