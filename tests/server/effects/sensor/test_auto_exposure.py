from __future__ import annotations

import pytest

from catoptra_server.effects.kernels.grey_levels import mean_luminance
from catoptra_server.effects.sensor.auto_exposure import AutoExposure
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion, make_test_pattern

DEFAULT_AUTO_EXPOSURE = AutoExposure(0.18, 0.1, 10.0)


@pytest.mark.parametrize("largest", [0.1, 1.0, 5.0])
def test_mean_when_the_gain_suffices_is_the_target(largest: float) -> None:
    behind = DEFAULT_AUTO_EXPOSURE.apply(make_test_pattern(largest), CAMERA, CAPTURE_CONTEXT)
    assert mean_luminance(behind, CAMERA) == pytest.approx(0.18, rel=1e-12)


@pytest.mark.parametrize(("largest", "gain"), [(1e-3, 10.0), (100.0, 0.1), (0.0, 10.0)])
def test_gain_when_the_target_is_out_of_reach_stays_at_its_limit(
    largest: float, gain: float
) -> None:
    assert DEFAULT_AUTO_EXPOSURE.gain(mean_luminance(make_test_pattern(largest), CAMERA)) == gain


def test_criterion_enables_a_free_gain_and_no_pinned_one() -> None:
    assert_criterion(
        off=[(AutoExposure(0.18, 0.9995, 1.0005), 1.0)], on=[(DEFAULT_AUTO_EXPOSURE, 1.0)]
    )
