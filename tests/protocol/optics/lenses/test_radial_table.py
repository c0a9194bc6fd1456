"""Measured lens: a table with a smooth curve."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import EquisolidLens, RadialTableLens
from helpers.lens_checks import assert_is_projection, assert_rejects, radii, theta_deg_from_radius

ANGLES = tuple(np.linspace(0.0, 120.0, 25).tolist())
LENS = RadialTableLens(ANGLES, tuple(radii(EquisolidLens(), *ANGLES).tolist()))


def test_table_is_a_projection_through_its_knots() -> None:
    assert_is_projection(LENS, to_rad=math.radians(119.9))
    assert_rejects(LENS, math.tan(math.radians(60.1)))
    assert radii(LENS, *ANGLES) == pytest.approx(LENS.radii, abs=1e-14)


def test_curve_between_the_knots_is_that_of_the_lens() -> None:
    between = np.linspace(0.0, 120.0, 1000)
    # Knots of 5 degrees, and a fourth derivative of at most 1 / 8.
    assert radii(LENS, *between) == pytest.approx(radii(EquisolidLens(), *between), abs=5e-7)


def test_table_ends_at_its_last_angle() -> None:
    assert theta_deg_from_radius(LENS, LENS.radii[-1]) == pytest.approx(120.0)
    assert math.isinf(theta_deg_from_radius(LENS, LENS.radii[-1] + 1e-9))


def test_table_may_reach_the_antipode() -> None:
    angles = tuple(np.linspace(0.0, 180.0, 19).tolist())
    lens = RadialTableLens(angles, angles)
    assert math.isinf(lens.t_limit)
    assert radii(lens, 180.0) == pytest.approx(180.0)


BAD = [
    ((0.0, 10.0, 20.0), (0.0, 1.0, 2.0), "4 to 512"),
    ((0.0, 10.0, 20.0, 30.0), (0.0, 1.0, 2.0, 2.0), "2.0 follows 2.0"),
    ((0.0, 10.0, 20.0, 30.0), (0.5, 1.0, 2.0, 3.0), "starts at 0"),
    ((0.0, 10.0, 20.0, 30.0), (0.0, 1.0, 2.0, 3.0, 4.0), "as many radii"),
    ((0.0, 10.0, 20.0, 190.0), (0.0, 1.0, 2.0, 3.0), "180 deg"),
    ((0.0, 10.0, 20.0, 30.0), (0.0, 1.0, math.nan, 3.0), "finite"),
    ((0.0, 10.0, 10.1, 30.0), (0.0, 1.0, 5.0, 5.1), "turns back"),
]


@pytest.mark.parametrize(("angles", "values", "message"), BAD)
def test_bad_table_is_rejected_with_the_reason(
    angles: tuple[float, ...], values: tuple[float, ...], message: str
) -> None:
    with pytest.raises(DomainError, match=message):
        RadialTableLens(angles, values)
