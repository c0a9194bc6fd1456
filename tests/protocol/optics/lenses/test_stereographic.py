"""Stereographic lens: conformal, and the paper's Eq. 2."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.lenses import StereographicLens
from catoptra_protocol.optics.mirrors.hyperbolic import eq2_radius_ratio_from_t
from helpers.lens_checks import assert_is_projection, assert_rejects, radii

LENS = StereographicLens()


def test_radius_is_twice_the_tangent_of_half_the_angle() -> None:
    assert_is_projection(LENS, to_rad=math.radians(179.0))
    assert_rejects(LENS, math.inf)
    assert radii(LENS, 90.0, 120.0) == pytest.approx((2.0, 2.0 * math.sqrt(3.0)))


def test_scales_along_and_across_the_radius_are_equal() -> None:
    t = np.linspace(0.1, 5.0, 9)
    across = LENS.radius_ratio_from_t(t) * (1.0 + t * t) / (2.0 * t)
    assert LENS.radius_ratio_slope(t) == pytest.approx(across)


def test_half_of_it_is_eq_2() -> None:
    t = np.linspace(0.0, 1.7, 9)
    assert 0.5 * LENS.radius_ratio_from_t(t) == pytest.approx(eq2_radius_ratio_from_t(t))
