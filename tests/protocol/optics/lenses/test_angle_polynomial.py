"""Polynomials of the angle: first fold, inverse, slope."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses.angle_polynomial import AnglePolynomial, half_angle_from_theta

# r = theta - theta^3 / 3 has the slope 1 - theta^2.
FOLDED = AnglePolynomial((1.0, 0.0, -1.0 / 3.0))


def test_polynomial_turns_back_where_its_slope_is_zero() -> None:
    assert FOLDED.fold_rad == pytest.approx(1.0, abs=1e-14)
    assert FOLDED.limit_rad == FOLDED.fold_rad
    assert FOLDED.slope(np.array([0.0, 1.0])) == pytest.approx((1.0, 0.0), abs=1e-15)


def test_polynomial_without_a_fold_ends_at_the_antipode() -> None:
    polynomial = AnglePolynomial((2.0, 0.5))
    assert math.isinf(polynomial.fold_rad)
    assert polynomial.limit_rad == math.pi


def test_angle_of_a_radius_is_exact_and_infinite_beyond_the_limit() -> None:
    theta = np.array([0.0, 1e-12, 0.5, 1.0 - 1e-3])
    assert FOLDED.solve(FOLDED.evaluate(theta)) == pytest.approx(theta, rel=1e-12)
    assert np.isinf(FOLDED.solve(np.array([0.7])))


@pytest.mark.parametrize("coefficients", [(), (0.0, 1.0), (-1.0,), (1.0, math.nan)])
def test_polynomial_that_does_not_grow_from_the_axis_is_rejected(
    coefficients: tuple[float, ...],
) -> None:
    with pytest.raises(DomainError, match=r"grow|finite"):
        AnglePolynomial(coefficients)


def test_half_angle_of_no_angle_is_infinite() -> None:
    t = half_angle_from_theta(np.array([0.0, 0.5 * math.pi, math.inf]))
    assert t == pytest.approx((0.0, 1.0, math.inf))
