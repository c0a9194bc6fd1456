"""Inverse of an increasing function of one variable, to the last digits, for whole arrays.

Newton's method inside a bracket: a step that leaves the bracket is replaced by a bisection, so that
the iteration converges for every increasing function and at the rate of Newton near the root. The
start comes from a table of the function, which is computed once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.numerics import Floats

# Newton doubles the digits of a table's start; bisections of the last bracket add 60.
_MAX_STEPS = 80
_TABLE_ENTRIES = 1025

Function = Callable[[Floats], Floats]


def tabulate(function: Function, low: float, high: float) -> tuple[Floats, Floats]:
    """Arguments and values of a function, for the starts of `solve_increasing`."""
    arguments = np.linspace(low, high, _TABLE_ENTRIES)
    return arguments, function(arguments)


def solve_increasing(
    function: Function, slope: Function, values: Floats, table: tuple[Floats, Floats]
) -> Floats:
    """Arguments at which an increasing function has the given values.

    Args:
        function: The function, increasing over the table's arguments.
        slope: Its derivative, at least 0.
        values: (...) values within those of the table; others give the nearer end.
        table: Arguments and values from `tabulate`.
    """
    arguments, known = table
    wanted = np.clip(np.ravel(values), known[0], known[-1])
    after = np.clip(np.searchsorted(known, wanted), 1, len(known) - 1)
    low, high = arguments[after - 1], arguments[after]
    x = low + (high - low) * _fraction(wanted, known[after - 1], known[after])
    solution, place = x.copy(), np.arange(x.size)
    for _ in range(_MAX_STEPS):
        error = function(x) - wanted
        low, high = np.where(error <= 0.0, x, low), np.where(error >= 0.0, x, high)
        steepness = slope(x)
        step = error / np.where(steepness > 0.0, steepness, 1.0)
        following = x - step
        is_outside = ~((following >= low) & (following <= high)) | (steepness <= 0.0)
        following = np.where(is_outside, 0.5 * (low + high), following)
        # Next to a fold, where the slope vanishes, arguments have fewer digits than values.
        following = np.where(np.abs(error) <= np.spacing(wanted), x, following)
        # Equal to the last bit or nearly: a further step would jump between neighbours.
        is_solved = np.abs(following - x) <= 2.0 * np.spacing(np.abs(x))
        solution[place] = following
        left = ~is_solved
        if not left.any():
            break
        x, place, wanted = following[left], place[left], wanted[left]
        low, high = low[left], high[left]
    return solution.reshape(np.shape(values))


def _fraction(values: Floats, low: Floats, high: Floats) -> Floats:
    span = high - low
    return np.where(span > 0.0, (values - low) / np.where(span > 0.0, span, 1.0), 0.0)
