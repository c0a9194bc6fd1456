"""Functions of one variable: inverses of increasing ones, splines through knots, first folds.

Inverse: Newton's method inside a bracket. A step that leaves the bracket is replaced by a
bisection, so that the iteration converges for every increasing function, to the last digits and at
the rate of Newton near the root. The start comes from a table of the function, which is computed
once.

Spline: cubic, smooth to second order. Measured projections and mirror profiles are knots; a ray's
direction is a derivative of a profile, so the profile must have a continuous curvature. Odd
functions (an image radius by its angle) have no curvature at 0, even ones (a profile by its radius)
no slope; the other end is not-a-knot, which keeps the third derivative continuous at the last knot
but one. Source: de Boor, A Practical Guide to Splines, 1978.

First fold: the angle at which an image radius turns back. Two directions with one image radius
cannot be told apart, so a camera model ends there, whatever its formula claims: a published
calibration of a fish-eye lens turns back at 118.3 degrees where its formula reaches 146.6.

Each projection computes its fold from the roots of its derivative; a rim beyond it is rejected with
both angles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum
from itertools import pairwise

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import cos, solve_linear
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass

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


_MIN_KNOTS = 4
"""Knots of a spline that is not-a-knot at its end."""
# The spline is the solution of a dense system; a camera's pairs are a datagram.
_MAX_KNOTS = 512


def check_column(name: str, values: tuple[float, ...]) -> None:
    """Raise DomainError unless a column of a measured table starts at 0 and increases."""
    if not isinstance(values, tuple) or not _MIN_KNOTS <= len(values) <= _MAX_KNOTS:
        raise DomainError(f"a table of {name} has {_MIN_KNOTS} to {_MAX_KNOTS} entries")
    if not all(map(math.isfinite, values)) or values[0] != 0.0:
        raise DomainError(f"a table of {name} is finite and starts at 0: {values[0]!r}")
    falling = next(((low, high) for low, high in pairwise(values) if high <= low), None)
    if falling is not None:
        raise DomainError(f"a table of {name} increases: {falling[1]!r} follows {falling[0]!r}")


class Symmetry(Enum):
    """Symmetry of a function about its first knot."""

    ODD = "odd"
    EVEN = "even"


@dataclass(frozen=True, slots=True, eq=False)
class CubicSpline:
    """Values and slopes at knots, with cubic polynomials between."""

    knots: Floats
    """(n,) increasing arguments, n >= 4."""
    values: Floats
    """(n,) function values."""
    slopes: Floats
    """(n,) first derivatives."""

    def evaluate(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Value, first and second derivative; beyond the knots by the last polynomial."""
        i = np.clip(np.searchsorted(self.knots, x, side="right") - 1, 0, len(self.knots) - 2)
        h = self.knots[i + 1] - self.knots[i]
        s = (x - self.knots[i]) / h
        low, high = self.values[i], self.values[i + 1]
        m0, m1 = h * self.slopes[i], h * self.slopes[i + 1]
        rise = high - low
        # Horner's scheme of the Hermite polynomial in s.
        c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        value = low + s * (m0 + s * (c2 + s * c3))
        first = (m0 + s * (2.0 * c2 + 3.0 * s * c3)) / h
        second = (2.0 * c2 + 6.0 * s * c3) / np.square(h)
        return value, first, second

    def smallest_slope(self) -> float:
        """Smallest first derivative between the first and the last knot."""
        h = np.diff(self.knots)
        m0, m1 = h * self.slopes[:-1], h * self.slopes[1:]
        rise = np.diff(self.values)
        c2, c3 = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        # The slope is a parabola in s: smallest at an end or at its vertex.
        is_curved = np.abs(c3) > 0.0
        vertex = np.clip(-c2 / np.where(is_curved, 3.0 * c3, 1.0), 0.0, 1.0)
        at_vertex = m0 + vertex * (2.0 * c2 + 3.0 * vertex * c3)
        return float((np.minimum(np.minimum(m0, m1), at_vertex) / h).min())


def fit_spline(knots: Floats, values: Floats, symmetry: Symmetry) -> CubicSpline:
    """Spline through (n,) increasing knots, n >= 4, symmetric about the first one."""
    n, h = len(knots), np.diff(knots)
    secants = np.diff(values) / h
    matrix, right = np.zeros((n, n)), np.zeros(n)
    # Continuous second derivatives at the inner knots.
    inner = np.arange(1, n - 1)
    matrix[inner, inner - 1] = 1.0 / h[:-1]
    matrix[inner, inner] = 2.0 * (1.0 / h[:-1] + 1.0 / h[1:])
    matrix[inner, inner + 1] = 1.0 / h[1:]
    right[1:-1] = 3.0 * (secants[:-1] / h[:-1] + secants[1:] / h[1:])
    if symmetry is Symmetry.EVEN:
        matrix[0, 0] = 1.0 / h[0]
    else:
        matrix[0, :2], right[0] = (2.0 / h[0], 1.0 / h[0]), 3.0 * secants[0] / h[0]
    # The third derivatives of the last two polynomials are equal.
    a, b = h[-2], h[-1]
    matrix[-1, -3:] = (-1.0 / (a * a), 1.0 / (b * b) - 1.0 / (a * a), 1.0 / (b * b))
    right[-1] = 2.0 * (secants[-1] / (b * b) - secants[-2] / (a * a))
    slopes = solve_linear(matrix, right[:, None])[:, 0]
    return CubicSpline(knots, values, slopes)


# Of a root's size: by less a slope's minimum may miss 0 and be a double root.
_DOUBLE_ROOT = 1e-7


def first_root(coefficients: Floats, *, low: float, high: float) -> float:
    """Smallest real root of a polynomial in an interval; inf if there is none.

    Args:
        coefficients: (n,) from the constant term on.
        low: Lower end, excluded.
        high: Upper end, included.
    """
    terms = np.trim_zeros(np.asarray(coefficients, dtype=np.float64), "b").tolist()
    if len(terms) < 2:
        return math.inf
    # Cauchy's bound of all roots.
    bound = 1.0 + max(abs(term / terms[-1]) for term in terms[:-1])
    if math.isinf(bound):
        raise OverflowError("overflow of a bound of roots")
    return next(iter(_find_roots(terms, low, min(high, bound))), math.inf)


def _find_roots(terms: list[float], low: float, high: float) -> list[float]:
    """Real roots in an interval, ascending: one between two turns at most."""
    if len(terms) == 2:
        return [root] if low < (root := -terms[0] / terms[1]) <= high else []
    slope = [power * term for power, term in enumerate(terms)][1:]
    curvature = [power * term for power, term in enumerate(slope)][1:]
    roots: list[float] = []
    for begin, end in pairwise((low, *_find_roots(slope, low, high), high)):
        before, after = _evaluate(terms, begin), _evaluate(terms, end)
        reach = _DOUBLE_ROOT * max(abs(end), 1.0)
        if before * after < 0.0:
            roots.append(_bisect(terms, begin, end, before))
        elif abs(after) <= 0.5 * abs(_evaluate(curvature, end)) * reach * reach:
            roots.append(end)
    return roots


def _bisect(terms: list[float], begin: float, end: float, before: float) -> float:
    """The root between two arguments, at the first of which the polynomial has a value."""
    while begin < (middle := 0.5 * (begin + end)) < end:
        if _evaluate(terms, middle) * before > 0.0:
            begin = middle
        else:
            end = middle
    return end


def _evaluate(terms: list[float], x: float) -> float:
    """Polynomial, by Horner's scheme."""
    value = 0.0
    for term in reversed(terms):
        value = value * x + term
    return value


def gauss_legendre(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights, (count,) each, of Gauss's quadrature over the interval from -1 to 1."""
    x: Floats = -cos(np.arange(0.75, count) * (math.pi / (count + 0.5)))
    for _ in range(_LEGENDRE_STEPS):
        before, value = np.ones_like(x), x
        for degree in range(2, count + 1):
            rise = (2.0 * degree - 1.0) * x * value - (degree - 1.0) * before
            before, value = value, rise / degree
        slope = count * (x * value - before) / (x * x - 1.0)
        x = x - value / slope
    return x, 2.0 / ((1.0 - x * x) * slope * slope)


# Newton doubles the four digits of the start.
_LEGENDRE_STEPS = 4
