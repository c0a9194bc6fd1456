from __future__ import annotations

import numpy as np

from catoptra_server.effects.sensor.exposure import Exposure
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion, make_test_pattern

LONG_EXPOSURE = Exposure(0.1, 0.02)


def test_light_when_the_shutter_is_open_longer_grows_with_the_time() -> None:
    np.testing.assert_allclose(
        LONG_EXPOSURE.apply(make_test_pattern(), CAMERA, CAPTURE_CONTEXT),
        5.0 * make_test_pattern(),
        rtol=1e-15,
    )


def test_criterion_enables_other_times_than_whites_by_day() -> None:
    assert_criterion(
        off=[
            (Exposure(0.02, 0.02), 1.0),
            (Exposure(0.02005, 0.02), 1.0),
            (LONG_EXPOSURE, 1e-5),
        ],
        on=[(LONG_EXPOSURE, 1.0), (Exposure(0.005, 0.02), 1.0)],
    )
