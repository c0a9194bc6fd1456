from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.effects.sensor.quantisation import Quantisation
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT, assert_criterion


def test_light_when_converted_is_a_whole_code_at_most_half_a_step_away() -> None:
    image = np.linspace(-0.05, 1.0, 3000).reshape(10, 100, 3)
    codes = 1023.0 * Quantisation(10).apply(image, CAMERA, CAPTURE_CONTEXT)
    np.testing.assert_allclose(codes, np.rint(codes), atol=1e-9)
    assert np.abs(codes - 1023.0 * image).max() <= 0.5 + 1e-9


def test_error_when_light_is_anything_has_the_variance_of_a_twelfth() -> None:
    image = np.random.default_rng(2).uniform(0.0, 1.0, (200, 200, 3))
    error = 255.0 * (Quantisation(8).apply(image, CAMERA, CAPTURE_CONTEXT) - image)
    assert error.var() == pytest.approx(1.0 / 12.0, rel=0.02)


def test_light_when_beyond_white_is_white() -> None:
    assert Quantisation(8).apply(np.full((2, 2, 3), 7.0), CAMERA, CAPTURE_CONTEXT).max() == 1.0


def test_criterion_enables_eight_bits_and_not_twelve() -> None:
    assert_criterion(off=[(Quantisation(12), 1.0)], on=[(Quantisation(8), 1.0)])
