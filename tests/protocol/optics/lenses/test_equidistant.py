"""Equidistant lens: r = f theta up to the antipode."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.lenses import EquidistantLens
from helpers.lens_checks import assert_is_projection, assert_rejects, radii, theta_deg_from_radius

LENS = EquidistantLens()


def test_radius_is_the_angle() -> None:
    assert_is_projection(LENS)
    assert_rejects(LENS)
    assert radii(LENS, 0.0, 90.0, 110.0) == pytest.approx(np.radians((0.0, 90.0, 110.0)))


def test_antipode_is_a_circle() -> None:
    assert math.isinf(LENS.t_limit)
    assert float(LENS.radius_ratio_from_t(np.array(math.inf))) == math.pi
    assert theta_deg_from_radius(LENS, math.pi) == pytest.approx(180.0)
    assert math.isinf(theta_deg_from_radius(LENS, 3.2))
