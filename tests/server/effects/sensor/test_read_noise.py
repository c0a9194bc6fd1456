from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.sensor.read_noise import ReadNoise
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion

SENSOR = ReadNoise(13.0, 18000.0)


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_spread_in_electrons_is_the_amplifiers_whatever_the_light(level: float) -> None:
    image = np.full((200, 200, 3), level)
    assert 18000.0 * (SENSOR.apply(image, CAMERA, CAPTURE_CONTEXT) - image).std() == pytest.approx(
        13, rel=0.01
    )


def test_criterion_enables_a_usual_amplifier_and_no_noiseless_one() -> None:
    assert_criterion(off=[(ReadNoise(0.4, 18000.0), 1.0)], on=[(SENSOR, 1.0)])
