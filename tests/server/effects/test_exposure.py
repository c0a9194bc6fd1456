from __future__ import annotations

import numpy as np

from catoptra_server.effects.exposure import Exposure
from helpers.effects import (
    CAMERA,
    CAPTURE,
    assert_called_for,
    assert_left_out,
    assert_summary_holds,
    card,
)

LONG = Exposure(0.1, 0.02)


def test_light_when_the_shutter_is_open_longer_grows_with_the_time() -> None:
    np.testing.assert_allclose(LONG.apply(card(), CAMERA, CAPTURE), 5.0 * card(), rtol=1e-15)


def test_white_time_when_criterion_is_asked_is_left_out() -> None:
    assert_left_out(Exposure(0.02, 0.02))
    assert_left_out(Exposure(0.02005, 0.02))


def test_other_time_when_criterion_is_asked_is_called_for() -> None:
    assert_called_for(LONG)
    assert_called_for(Exposure(0.005, 0.02))
    assert_summary_holds(LONG, 2.0)


def test_night_when_criterion_is_asked_needs_no_exposure() -> None:
    assert_left_out(LONG, 1e-5)
