"""Cubic splines: knots, smoothness, symmetry, order of the error."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.curves import CubicSpline, Symmetry, fit_spline
from catoptra_protocol.optics.numerics import Floats


def spline_of(function: np.ufunc, num_knots: int, symmetry: Symmetry) -> CubicSpline:
    knots: Floats = np.linspace(0.0, 2.0, num_knots) ** 1.2
    return fit_spline(knots, function(knots), symmetry)


@pytest.mark.parametrize(
    ("function", "symmetry"), [(np.sin, Symmetry.ODD), (np.cos, Symmetry.EVEN)]
)
def test_error_falls_with_the_fourth_power_of_the_spacing(
    function: np.ufunc, symmetry: Symmetry
) -> None:
    x = np.linspace(0.0, 2.0**1.2, 999)
    errors = [
        np.abs(spline_of(function, n, symmetry).evaluate(x)[0] - function(x)).max() for n in (9, 17)
    ]
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] > 10.0


def test_curve_is_smooth_to_second_order_and_passes_its_knots() -> None:
    spline = spline_of(np.sin, 9, Symmetry.ODD)
    inner = spline.knots[1:-1]
    assert spline.evaluate(spline.knots)[0] == pytest.approx(spline.values, abs=1e-15)
    for before, after in zip(
        spline.evaluate(inner - 1e-9), spline.evaluate(inner + 1e-9), strict=True
    ):
        assert before == pytest.approx(after, abs=1e-7)


def test_symmetry_is_that_of_the_function_at_its_first_knot() -> None:
    assert spline_of(np.sin, 9, Symmetry.ODD).evaluate(np.array(0.0))[2] == pytest.approx(0.0)
    assert spline_of(np.cos, 9, Symmetry.EVEN).evaluate(np.array(0.0))[1] == pytest.approx(0.0)


def test_derivatives_are_those_of_the_value() -> None:
    spline, x, step = spline_of(np.sin, 9, Symmetry.ODD), np.linspace(0.1, 2.0, 50), 1e-6
    _, first, second = spline.evaluate(x)
    ahead, behind = spline.evaluate(x + step), spline.evaluate(x - step)
    assert (ahead[0] - behind[0]) / (2.0 * step) == pytest.approx(first, abs=1e-9)
    assert (ahead[1] - behind[1]) / (2.0 * step) == pytest.approx(second, abs=1e-6)


def test_smallest_slope_is_found_between_knots() -> None:
    knots = np.array([0.0, 1.0, 1.1, 3.0])
    spline = fit_spline(knots, np.array([0.0, 1.0, 5.0, 5.1]), Symmetry.ODD)
    x = np.linspace(0.0, 3.0, 100_001)
    assert spline.smallest_slope() == pytest.approx(spline.evaluate(x)[1].min(), rel=1e-6)
    assert spline.smallest_slope() < 0.0
