from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects import CaptureContext
from catoptra_server.effects.sensor.shot_noise import ShotNoise
from catoptra_server.world.objects import NoiseSeed
from helpers.effect_measurement import CAMERA, NOISE_SEED, assert_criterion

SENSOR = ShotNoise(18000.0)


def measure_flat_field(
    level: float, seed: NoiseSeed = NOISE_SEED
) -> np.ndarray[tuple[int, int, int]]:
    return SENSOR.apply(np.full((200, 200, 3), level), CAMERA, CaptureContext(seed))


@pytest.mark.parametrize("level", [0.001, 0.05, 0.5, 0.9])
def test_variance_in_electrons_is_their_number(level: float) -> None:
    electrons = 18000.0 * measure_flat_field(level)
    # 120 000 pixels: a variance is known to 0.4 %, a mean to 0.3 % of a standard deviation.
    assert electrons.var() == pytest.approx(18000.0 * level, rel=0.02)
    assert electrons.mean() == pytest.approx(18000.0 * level, abs=0.02 * electrons.std())


def test_noise_of_the_next_frame_is_independent() -> None:
    first, second = (
        measure_flat_field(0.5),
        measure_flat_field(0.5, NoiseSeed(NOISE_SEED.camera_key, NOISE_SEED.tick + 1)),
    )
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.02


def test_frame_when_drawn_twice_has_the_same_bytes() -> None:
    assert measure_flat_field(0.5).tobytes() == measure_flat_field(0.5).tobytes()


def test_well_when_full_is_not_exceeded_and_the_dark_is_noiseless() -> None:
    assert measure_flat_field(3.0).min() == measure_flat_field(3.0).max() == 1.0
    assert not measure_flat_field(0.0).any()


def test_criterion_enables_a_usual_well_and_no_enormous_one() -> None:
    assert_criterion(off=[(ShotNoise(1e8), 1.0)], on=[(SENSOR, 1.0)])
