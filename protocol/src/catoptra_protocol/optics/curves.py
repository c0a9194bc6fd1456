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
        matrix[0, 0] = 1.0
    else:
        matrix[0, :2], right[0] = (2.0, 1.0), 3.0 * secants[0]
    # The third derivatives of the last two polynomials are equal.
    a, b = h[-2], h[-1]
    matrix[-1, -3:] = (-1.0 / a**2, 1.0 / b**2 - 1.0 / a**2, 1.0 / b**2)
    right[-1] = 2.0 * (secants[-1] / b**2 - secants[-2] / a**2)
    slopes = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    return CubicSpline(knots, values, slopes)


# A companion matrix finds a simple root to a dozen digits.
_MAX_STEP = 1e-6


def first_root(coefficients: Floats, *, low: float, high: float) -> float:
    """Smallest real root of a polynomial in an interval; inf if there is none.

    Args:
        coefficients: (n,) from the constant term on.
        low: Lower end, excluded.
        high: Upper end, included.
    """
    terms = np.trim_zeros(np.asarray(coefficients, dtype=np.float64), "b")
    if len(terms) < 2:
        return math.inf
    roots = np.polynomial.polynomial.polyroots(terms)
    scale = np.maximum(np.abs(roots), 1.0)
    # A double root, where the slope only touches 0, comes as a pair beside the axis.
    real = roots.real[np.abs(roots.imag) <= 1e-7 * scale]
    inside = real[(real > low) & (real <= high)]
    return float(_polish(terms, float(inside.min()))) if len(inside) else math.inf


def _polish(terms: Floats, root: float) -> float:
    """A root after three Newton steps: companion matrices lose digits."""
    derivative = np.polynomial.polynomial.polyder(terms)
    for _ in range(3):
        slope = float(np.polynomial.polynomial.polyval(root, derivative))
        step = float(np.polynomial.polynomial.polyval(root, terms)) / slope if slope else math.inf
        # Next to a double root the slope vanishes, and a step would leave it.
        if abs(step) > _MAX_STEP * max(abs(root), 1.0):
            break
        root -= step
    return root
