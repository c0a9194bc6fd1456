"""Natural vignetting of flat and wide-angle images."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.image_scale import cosine_fourth, wide_angle_illumination
from catoptra_protocol.optics.lenses import (
    EquidistantLens,
    EquisolidLens,
    OrthographicLens,
    StereographicLens,
)


def test_fourth_power_of_the_cosine_needs_no_angle() -> None:
    angle = np.radians([0.0, 30.0, 89.9])
    assert cosine_fourth(np.tan(angle)) == pytest.approx(np.cos(angle) ** 4, rel=1e-12)


def test_illumination_is_the_solid_angle_of_a_pixel() -> None:
    theta = np.radians([0.0, 1e-7, 45.0, 90.0, 110.0])
    t = np.tan(0.5 * theta)
    equidistant = np.sinc(theta / math.pi)
    assert wide_angle_illumination(EquidistantLens(), t) == pytest.approx(equidistant, abs=1e-12)
    assert wide_angle_illumination(EquisolidLens(), t) == pytest.approx(np.ones(5), abs=1e-12)
    stereographic = np.cos(0.5 * theta) ** 4
    assert wide_angle_illumination(StereographicLens(), t) == pytest.approx(stereographic)


def test_no_lens_is_brighter_than_on_its_axis() -> None:
    # 1 / cos(theta) by the formula: infinite at 90 degrees.
    t = np.tan(0.5 * np.radians([0.0, 60.0, 90.0]))
    assert wide_angle_illumination(OrthographicLens(), t) == pytest.approx(np.ones(3))
