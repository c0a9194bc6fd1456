"""Effects by their own formulas: stages, changes and encoding."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.medium.vignetting import Vignetting
from catoptra_server.effects.sensor.exposure import Exposure
from catoptra_server.render.image_changer import (
    ExposedImage,
    NumpyImageChanger,
    encode_srgb,
    measure_change,
)
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, make_test_pattern

PATTERN = make_test_pattern().astype(np.float32)
EXPOSED = ExposedImage(PATTERN, CAMERA, CAPTURE_CONTEXT)


def test_effects_are_applied_in_their_order_and_measured_where_asked() -> None:
    effects = (Vignetting(), Exposure(0.02, 0.01))
    changed = NumpyImageChanger().change(EXPOSED, effects, {"Exposure": 0.5})
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


def test_change_is_in_encoded_levels_of_the_pixel_that_changes_most() -> None:
    before = np.full((2, 2, 3), 0.5, dtype=np.float32)
    after = before.copy()
    after[1, 0, 2] = 1.0
    # sRGB of 0.5 is 187.5 of 255.
    assert measure_change(before, after) == pytest.approx(255.0 - 187.52, abs=0.01)
    assert measure_change(before, before) == 0.0
