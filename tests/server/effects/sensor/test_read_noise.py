from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.sensor.read_noise import ReadNoise
from helpers.effect_measurement import (
    CAMERA,
    CAPTURE_CONTEXT,
    assert_effect_negligible,
    assert_effect_not_negligible,
    assert_summary_bounds_effect,
)

SENSOR = ReadNoise(13.0, 18000.0)


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_spread_in_electrons_is_the_amplifiers_whatever_the_light(level: float) -> None:
    image = np.full((200, 200, 3), level)
    assert 18000.0 * (SENSOR.apply(image, CAMERA, CAPTURE_CONTEXT) - image).std() == pytest.approx(
        13, rel=0.01
    )


def test_noiseless_amplifier_is_disabled_by_the_criterion() -> None:
    assert_effect_negligible(ReadNoise(0.4, 18000.0))


def test_usual_amplifier_is_enabled_by_the_criterion() -> None:
    assert_effect_not_negligible(SENSOR)
    assert_summary_bounds_effect(SENSOR, 1.2)
