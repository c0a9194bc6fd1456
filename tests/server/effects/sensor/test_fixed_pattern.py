from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects import CaptureContext
from catoptra_server.effects.sensor.fixed_pattern import FixedPattern
from catoptra_server.world.objects import NoiseSeed
from helpers.effect_measurement import CAMERA, NOISE_SEED, assert_criterion

SENSOR = FixedPattern(0.02, 9.0, 18000.0)


def measure_flat_field(
    level: float, seed: NoiseSeed = NOISE_SEED
) -> np.ndarray[tuple[int, int, int]]:
    return SENSOR.apply(np.full((200, 200, 3), level), CAMERA, CaptureContext(seed))


def test_pixels_when_dark_differ_by_the_dark_signal_alone() -> None:
    # 120 000 pixels: a standard deviation is known to 0.2 %.
    assert measure_flat_field(0.0).std() * 18000.0 == pytest.approx(9.0, rel=0.01)


def test_pixels_when_lit_differ_by_their_gain() -> None:
    assert (measure_flat_field(0.8) - measure_flat_field(0.3)).std() == pytest.approx(
        0.02 * 0.5, rel=0.01
    )


def test_pattern_when_a_frame_passes_stays_as_it_is() -> None:
    np.testing.assert_array_equal(
        measure_flat_field(0.5), measure_flat_field(0.5, NoiseSeed(NOISE_SEED.camera_key, 99))
    )


def test_pattern_of_another_camera_is_another_one() -> None:
    other = measure_flat_field(0.5, NoiseSeed((8, 11), NOISE_SEED.tick)) - 0.5
    mine = measure_flat_field(0.5) - 0.5
    assert abs(np.corrcoef(mine.ravel(), other.ravel())[0, 1]) < 0.02


def test_criterion_enables_an_uneven_sensor_alone() -> None:
    assert_criterion(off=[(FixedPattern(1e-4, 0.1, 18000.0), 1.0)], on=[(SENSOR, 1.0)])
