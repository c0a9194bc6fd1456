"""Inverse of increasing functions, also where their slope vanishes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.curves import Function, solve_increasing, tabulate
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
