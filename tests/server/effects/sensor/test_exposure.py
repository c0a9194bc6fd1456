from __future__ import annotations

import numpy as np

from catoptra_server.effects.sensor.exposure import Exposure
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_effect_negligible,
    assert_effect_not_negligible,
    assert_summary_bounds_effect,
    make_test_pattern,
)

LONG_EXPOSURE = Exposure(0.1, 0.02)


def test_light_when_the_shutter_is_open_longer_grows_with_the_time() -> None:
    np.testing.assert_allclose(
        LONG_EXPOSURE.apply(make_test_pattern(), CAMERA, CAPTURE_CONTEXT),
        5.0 * make_test_pattern(),
        rtol=1e-15,
    )


def test_white_time_is_disabled_by_the_criterion() -> None:
    assert_effect_negligible(Exposure(0.02, 0.02))
    assert_effect_negligible(Exposure(0.02005, 0.02))


def test_other_time_is_enabled_by_the_criterion() -> None:
    assert_effect_not_negligible(LONG_EXPOSURE)
    assert_effect_not_negligible(Exposure(0.005, 0.02))
    assert_summary_bounds_effect(LONG_EXPOSURE, 2.0)


def test_night_needs_no_exposure() -> None:
    assert_effect_negligible(LONG_EXPOSURE, 1e-5)
