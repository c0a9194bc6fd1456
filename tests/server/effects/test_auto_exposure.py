from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.auto_exposure import LUMINANCE, AutoExposure, mean_of, mirror_pixels
from helpers.effects import (
    CAMERA,
    CAPTURE,
    assert_called_for,
    assert_left_out,
    assert_summary_holds,
    card,
)

USUAL = AutoExposure(0.18, 0.1, 10.0)


@pytest.mark.parametrize("largest", [0.1, 1.0, 5.0])
def test_mean_when_the_gain_suffices_is_the_target(largest: float) -> None:
    behind = USUAL.apply(card(largest), CAMERA, CAPTURE)
    rim = card().any(axis=-1)
    seen = behind.sum(axis=(0, 1)) @ LUMINANCE / mirror_pixels(CAMERA)
    assert rim.sum() <= mirror_pixels(CAMERA)
    assert seen == pytest.approx(0.18, rel=1e-12)


@pytest.mark.parametrize(("largest", "gain"), [(1e-3, 10.0), (100.0, 0.1), (0.0, 10.0)])
def test_gain_when_the_target_is_out_of_reach_stays_at_its_limit(
    largest: float, gain: float
) -> None:
    assert USUAL.gain(mean_of(card(largest), CAMERA)) == gain


def test_gain_when_light_is_float32_is_that_of_float64() -> None:
    single = mean_of(card().astype(np.float32), CAMERA)
    assert single == pytest.approx(mean_of(card(), CAMERA), rel=1e-6)


def test_pinned_gain_when_criterion_is_asked_is_left_out() -> None:
    assert_left_out(AutoExposure(0.18, 0.9995, 1.0005))


def test_free_gain_when_criterion_is_asked_is_called_for() -> None:
    assert_called_for(USUAL)
    assert_summary_holds(USUAL, 2.0)
