from __future__ import annotations

import numpy as np

from catoptra_server.effects.sensor.white_balance import WhiteBalance
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion

WARM_BALANCE = WhiteBalance(1.6, 0.7)


def test_colours_when_balanced_are_amplified_against_green() -> None:
    behind = WARM_BALANCE.apply(np.full((1, 1, 3), 0.5), CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(behind[0, 0], (0.8, 0.5, 0.35), rtol=1e-15)


def test_white_when_clipped_before_takes_on_the_gains() -> None:
    behind = WARM_BALANCE.apply(np.full((1, 1, 3), 40.0), CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(behind[0, 0], (1.6, 1.0, 0.7), rtol=1e-15)


def test_criterion_enables_warm_gains_and_no_neutral_ones() -> None:
    assert_criterion(
        off=[(WhiteBalance(1.002, 0.999), 1.0), (WhiteBalance(1.0, 1.0), 5.0)],
        on=[(WARM_BALANCE, 1.0), (WhiteBalance(1.0, 1.01), 1.0)],
    )
