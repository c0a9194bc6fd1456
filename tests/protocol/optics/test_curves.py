"""Splines, inverses and folds of functions of one variable."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.curves import (
    CubicSpline,
    Function,
    Symmetry,
    first_root,
    fit_spline,
    solve_increasing,
    tabulate,
)
from catoptra_protocol.optics.numerics import Floats

CASES: list[tuple[Function, Function, float, float]] = [
    (lambda x: x + 0.1 * x**3, lambda x: 1.0 + 0.3 * x**2, 0.0, 5.0),
    (np.sin, np.cos, 0.0, 0.5 * math.pi),
    (lambda x: x**3, lambda x: 3.0 * x**2, 0.0, 2.0),
    (np.tan, lambda x: 1.0 + np.tan(x) ** 2, 0.0, 1.5707),
]


@pytest.mark.parametrize("case", CASES)
def test_value_of_the_solution_is_the_given_one(
    case: tuple[Function, Function, float, float],
) -> None:
    function, slope, low, high = case
    values = function(np.linspace(low, high, 777))
    x = solve_increasing(function, slope, values, tabulate(function, low, high))
    assert function(x) == pytest.approx(values, rel=1e-13, abs=1e-15)
    assert ((x >= low) & (x <= high)).all()


def test_value_beyond_the_table_has_its_nearer_end() -> None:
    table = tabulate(np.sin, 0.0, 1.0)
    x = solve_increasing(np.sin, np.cos, np.array([-1.0, 2.0]), table)
    assert x == pytest.approx((0.0, 1.0))


def test_value_next_to_the_start_keeps_its_digits() -> None:
    function = CASES[0][0]
    x = solve_increasing(function, CASES[0][1], np.array([1e-9]), tabulate(function, 0.0, 5.0))
    assert x == pytest.approx(1e-9, rel=1e-14)


def test_values_next_to_a_fold_take_few_steps() -> None:
    # One value without further digits must not repeat the function for all.
    num_evaluated = 0

    def parabola(x: Floats) -> Floats:
        nonlocal num_evaluated
        num_evaluated += x.size
        return x * (2.0 - x)

    values = 1.0 - np.geomspace(1e-16, 1.0, 1000)
    table = tabulate(parabola, 0.0, 1.0)
    num_evaluated = 0
    x = solve_increasing(parabola, lambda x: 2.0 - 2.0 * x, values, table)
    assert parabola(x) == pytest.approx(values, abs=3e-16)
    assert num_evaluated < 12 * len(values)


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


def test_first_root_is_the_smallest_inside() -> None:
    # (x - 1)(x - 2)(x + 3)
    terms = np.array([6.0, -7.0, 0.0, 1.0])
    assert first_root(terms, low=0.0, high=math.inf) == pytest.approx(1.0, abs=1e-15)
    assert first_root(terms, low=1.5, high=math.inf) == pytest.approx(2.0, abs=1e-15)
    assert math.isinf(first_root(terms, low=0.0, high=0.9))


def test_double_root_is_found() -> None:
    assert first_root(np.array([1.0, -2.0, 1.0]), low=0.0, high=2.0) == pytest.approx(1.0, abs=1e-7)


@pytest.mark.parametrize("terms", [[1.0], [0.0, 0.0], [1.0, 0.0, 1.0], [2.0, 0.0, 0.0]])
def test_polynomial_without_a_root_has_none(terms: list[float]) -> None:
    assert math.isinf(first_root(np.array(terms), low=0.0, high=math.inf))
