"""Equisolid lens: equal solid angles have equal areas."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.lenses import EquisolidLens
from helpers.lens_checks import assert_is_projection, assert_rejects, radii, theta_deg_from_radius

LENS = EquisolidLens()


def test_radius_is_twice_the_sine_of_half_the_angle() -> None:
    assert_is_projection(LENS, to_rad=math.pi - 1e-6)
    assert_rejects(LENS)
    assert radii(LENS, 60.0, 180.0) == pytest.approx((1.0, 2.0))


def test_area_is_the_solid_angle() -> None:
    theta = np.linspace(0.0, math.pi, 9)
    area = math.pi * np.square(LENS.radius_ratio_from_t(np.tan(0.5 * theta)))
    assert area == pytest.approx(2.0 * math.pi * (1.0 - np.cos(theta)))


def test_radius_of_the_antipode_ends_the_image() -> None:
    assert math.isinf(theta_deg_from_radius(LENS, 2.0 + 1e-12))
