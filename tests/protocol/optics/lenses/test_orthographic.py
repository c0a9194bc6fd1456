"""Orthographic lens: a hemisphere."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.optics.lenses import OrthographicLens
from helpers.lens_checks import assert_is_projection, assert_rejects, radii, theta_deg_from_radius

LENS = OrthographicLens()


def test_radius_is_the_sine_up_to_90_degrees() -> None:
    assert_is_projection(LENS, to_rad=math.radians(89.9))
    assert_rejects(LENS, 1.0 + 1e-6)
    assert radii(LENS, 30.0, 90.0) == pytest.approx((0.5, 1.0))


def test_radius_beyond_the_focal_length_shows_nothing() -> None:
    assert theta_deg_from_radius(LENS, 1.0) == pytest.approx(90.0)
    assert math.isinf(theta_deg_from_radius(LENS, 1.0 + 1e-12))
