from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.capture import Capture
from catoptra_server.effects.fixed_pattern import FixedPattern
from catoptra_server.effects.frame_key import FrameKey
from helpers.effects import CAMERA, KEY, assert_called_for, assert_left_out, assert_summary_holds

SENSOR = FixedPattern(0.02, 9.0, 18000.0)


def measured(level: float, key: FrameKey = KEY) -> np.ndarray[tuple[int, int, int]]:
    return SENSOR.apply(np.full((200, 200, 3), level), CAMERA, Capture(key))


def test_pixels_when_dark_differ_by_the_dark_signal_alone() -> None:
    # 120 000 pixels: a standard deviation is known to 0.2 %.
    assert measured(0.0).std() * 18000.0 == pytest.approx(9.0, rel=0.01)


def test_pixels_when_lit_differ_by_their_gain() -> None:
    assert (measured(0.8) - measured(0.3)).std() == pytest.approx(0.02 * 0.5, rel=0.01)


def test_pattern_when_a_frame_passes_stays_as_it_is() -> None:
    np.testing.assert_array_equal(measured(0.5), measured(0.5, FrameKey(KEY.camera, 99)))


def test_pattern_of_another_camera_is_another_one() -> None:
    other = measured(0.5, FrameKey((8, 11), KEY.index)) - 0.5
    mine = measured(0.5) - 0.5
    assert abs(np.corrcoef(mine.ravel(), other.ravel())[0, 1]) < 0.02


def test_even_sensor_when_criterion_is_asked_is_left_out() -> None:
    assert_left_out(FixedPattern(1e-4, 0.1, 18000.0))


def test_uneven_sensor_when_criterion_is_asked_is_called_for() -> None:
    assert_called_for(SENSOR)
    assert_summary_holds(SENSOR, 1.5)
