from __future__ import annotations

import numpy as np

from catoptra_server.effects.sensor.white_balance import WhiteBalance
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_effect_negligible,
    assert_effect_not_negligible,
    assert_summary_bounds_effect,
)

WARM_BALANCE = WhiteBalance(1.6, 0.7)


def test_colours_when_balanced_are_amplified_against_green() -> None:
    behind = WARM_BALANCE.apply(np.full((1, 1, 3), 0.5), CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(behind[0, 0], (0.8, 0.5, 0.35), rtol=1e-15)


def test_white_when_clipped_before_takes_on_the_gains() -> None:
    behind = WARM_BALANCE.apply(np.full((1, 1, 3), 40.0), CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(behind[0, 0], (1.6, 1.0, 0.7), rtol=1e-15)


def test_neutral_gains_are_disabled_by_the_criterion() -> None:
    assert_effect_negligible(WhiteBalance(1.002, 0.999))
    assert_effect_negligible(WhiteBalance(1.0, 1.0), 5.0)


def test_warm_gains_are_enabled_by_the_criterion() -> None:
    assert_effect_not_negligible(WARM_BALANCE)
    assert_effect_not_negligible(WhiteBalance(1.0, 1.01))
    assert_summary_bounds_effect(WARM_BALANCE, 2.0)
