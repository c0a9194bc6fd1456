"""Elementary functions and small products of matrices, with the same bits on every machine.

NumPy's vector code, OpenBLAS and the C library choose their code by the processor, and their last
bits differ. Here are additions, subtractions, products, quotients and square roots alone, which
IEEE 754 rounds alike everywhere, in an order that shapes decide. NumPy computes each of these by
itself, so that no compiler can fuse two. Roundings to integers, scaling by powers of two, sums by
NumPy's `sum` and comparisons are exact or ordered too, and are used as they are.

Functions take a float or an array of float64; both have the same bits. Errors, in units of the
last place, against 50 digits in `tests/protocol/optics/test_elementary.py`:

| function                     | error                                                           |
|------------------------------|-----------------------------------------------------------------|
| sin, cos                     | 1; beyond 1.6e6 rad that of the argument besides                |
| tan                          | 3                                                               |
| arctan, arctan2              | 2                                                               |
| arcsin, arccos               | 3                                                               |
| hypot, exp, ln               | 1                                                               |
| power                        | 1 + the size of the result's logarithm                          |

Series are Taylor's, as long as float64 tells them from the function; arguments are reduced as in
W. Kahan's and K. C. Ng's fdlibm, by constants in parts whose products are exact.

Of protocol and server these still call libraries' functions whose last bits depend on the
processor. None is seen in a result but those of a driver or a reference that are named here:

* `calibration/`: files for other programs, which state what they leave.
* `commands/doctor/`: its self-test has a tolerance.
* `commands/draw_map.py`: a plan, for people.
* `config/sdf_world.py`: the text of a world file, which is written once and read alike everywhere.
* `frames/plan/costs.py`: measured times, which no two frames have alike.
* `frames/plan/faces.py`, `render/projection/`, `render/raster/`: for OpenGL, whose drivers have
  bits of their own.
* `render/trace/reference/`: draws where the kernel cannot run, and says so.
* `runtime/queues.py`, `serve/limits.py`: measured loads.
* `world/mesh_files.py`: the sign of a determinant of size 1. Where a mesh file nests transforms,
  trimesh multiplies them by BLAS; workers of a data set compare the triangles before they draw.

`statistics.NormalDist` fills the table of noise: all its entries are the same float32 as long as
the quantiles are right to 3e-14 (`tests/server/effects/kernels/test_grey_levels.py`). Python's own
`sum` and the bits of `numpy.random` do not depend on the processor. Denormal floats are 0 in the
kernel.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
_Real = TypeVar("_Real", float, Floats)
_FloatT = TypeVar("_FloatT", bound=np.floating[Any])

# pi / 2 and ln 2: a product of the first parts, of 33 and 32 bits, with a whole number is exact.
_QUARTER_TURN = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_LN2 = (0.6931471803691238, 1.9082149292705877e-10)
# Terms after the first, highest power first.
_SINE = [(-1) ** n / math.factorial(2 * n + 1) for n in range(8, 0, -1)]
_COSINE = [(-1) ** n / math.factorial(2 * n) for n in range(8, 1, -1)]
_ARCTAN = [(-1) ** n / (2 * n + 1) for n in range(9, 0, -1)]
_EXP = [1.0 / math.factorial(n) for n in range(14, 1, -1)]
_LOG = [2.0 / (2 * n + 1) for n in range(10, 0, -1)]
# arctan(i / 4), and what float64 leaves of it.
_ARCTAN_QUARTERS = (
    (0.0, 0.24497866312686414, 0.4636476090008061, 0.6435011087932844, 0.7853981633974483),
    (0.0, 1.06987556187344e-17, 2.26987774529617e-17, 1.58347850514443e-17, 3.06161699786838e-17),
)
_ARCTAN_TABLES = np.array(_ARCTAN_QUARTERS)
# The axis that an angle is counted from, and what float64 leaves of it: ahead, left and steep.
_UPWARD = (0.5 * math.pi, 6.123233995736766e-17)
_AXES = ((0.0, 0.0), (math.pi, 1.2246467991473532e-16), _UPWARD, _UPWARD)
_AXES_TABLE = np.array(_AXES).T


def _sum_powers(coefficients: list[float], x: Any) -> Any:
    """Polynomial without a constant term, highest power first, by Horner's scheme."""
    total = coefficients[0] * x
    for coefficient in coefficients[1:]:
        total += coefficient
        total *= x
    return total


def sin(angle_rad: _Real) -> _Real:
    """Sine."""
    sine: _Real = _sine_after_quarters(angle_rad, 0)
    return sine


def cos(angle_rad: _Real) -> _Real:
    """Cosine."""
    cosine: _Real = _sine_after_quarters(angle_rad, 1)
    return cosine


def _sine_after_quarters(angle_rad: Any, quarters: int) -> Any:
    """Sine of an angle plus quarters of a turn."""
    if isinstance(angle_rad, float | int):
        # A zero is its own sine, and has a sign that the memory of angles would lose.
        return _sine_of_one(angle_rad, quarters) if angle_rad else (angle_rad, 1.0)[quarters]
    with np.errstate(under="ignore"):
        rest, is_odd, turned = _reduce(angle_rad, quarters)
        values = np.where(is_odd, _cosine(*rest), _sine(*rest))
        return np.where(turned >= 2.0, -values, values)


@lru_cache(maxsize=256)
def _sine_of_one(angle_rad: float, quarters: int) -> float:
    """Of one angle; an angle is often asked for several times in a row."""
    turns = round(angle_rad / (0.5 * math.pi))
    function = _cosine if (turns + quarters) % 2 else _sine
    value: float = function(*_rest_of_quarters(float(angle_rad), turns))
    return -value if (turns + quarters) & 2 else value


def _reduce(angle_rad: Any, quarters: int) -> tuple[tuple[Any, Any], Any, Any]:
    """Rest of each angle, whether odd quarters were taken away, and those modulo 4."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    # Not -0.0, which would lose the sign of a zero.
    whole = np.rint(angle / (0.5 * math.pi)) + 0.0
    turned = whole + quarters
    turned = turned - 4.0 * np.floor(0.25 * turned)
    return _rest_of_quarters(angle, whole), (turned == 1.0) | (turned == 3.0), turned


def _rest_of_quarters(angle: Any, turns: Any) -> tuple[Any, Any]:
    """Angle less quarter turns, and by how much float64 rounded that up."""
    near = angle - turns * _QUARTER_TURN[0]
    far = turns * _QUARTER_TURN[1]
    rough = near - far
    correction = turns * _QUARTER_TURN[2] - ((near - rough) - far)
    rest = rough - correction
    return rest, correction - (rough - rest)


def _sine(x: Any, excess: Any) -> Any:
    square = x * x
    return x - (excess * (1.0 - 0.5 * square) - x * _sum_powers(_SINE, square))


def _cosine(x: Any, excess: Any) -> Any:
    square = x * x
    half = 0.5 * square
    begin = 1.0 - half
    return begin + (((1.0 - begin) - half) + (square * _sum_powers(_COSINE, square) + x * excess))


def tan(angle_rad: _Real) -> _Real:
    """Tangent."""
    if isinstance(angle_rad, float | int):
        return sin(angle_rad) / cos(angle_rad)
    with np.errstate(under="ignore"):
        rest, is_odd, _ = _reduce(angle_rad, 0)
        sine, cosine = _sine(*rest), _cosine(*rest)
        tangent: Floats = np.where(is_odd, -cosine, sine) / np.where(is_odd, sine, cosine)
        return tangent


@overload
def arctan2(y: float, x: float) -> float: ...
@overload
def arctan2(y: Floats, x: Floats | float) -> Floats: ...
@overload
def arctan2(y: float, x: Floats) -> Floats: ...
def arctan2(y: Any, x: Any) -> Any:
    """Angle of (x, y) from the x axis, -pi to pi; zeros have signs."""
    if isinstance(y, float | int) and isinstance(x, float | int):
        height, width = abs(float(y)), abs(float(x))
        low, high = min(height, width), max(height, width)
        if math.isnan(height + width):
            return math.nan
        ratio = low / high if low < high else float(high > 0.0)
        i = round(4.0 * ratio)
        angle = _arctan_near(ratio, 0.25 * i, _ARCTAN_QUARTERS[0][i], _ARCTAN_QUARTERS[1][i])
        is_steep, is_left = height > width, math.copysign(1.0, x) < 0.0
        axis, rest = _AXES[2 * is_steep + is_left]
        return math.copysign(axis + ((angle if is_steep == is_left else -angle) + rest), y)
    y, x = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(x, np.float64))
    heights, widths = np.abs(y), np.abs(x)
    highs = np.maximum(heights, widths)
    ratios = np.array(highs > 0.0, dtype=np.float64)
    with np.errstate(under="ignore"):
        np.divide(np.minimum(heights, widths), highs, out=ratios, where=~(heights == widths))
        # Of a ratio that is not a number the last entry, of which nothing remains.
        near = np.rint(np.fmin(4.0 * ratios, 4.0)).astype(np.intp)
        angles = _arctan_near(ratios, 0.25 * near, *_ARCTAN_TABLES[:, near])
        is_steep, is_left = heights > widths, np.signbit(x)
        axes, rests = _AXES_TABLE[:, 2 * is_steep + is_left]
        return np.copysign(axes + (np.where(is_steep == is_left, angles, -angles) + rests), y)


def _arctan_near(ratio: Any, known: Any, angle: Any, angle_rest: Any) -> Any:
    """Arctangent of a ratio by that of a ratio at most 1 / 8 away."""
    tangent = (ratio - known) / (1.0 + ratio * known)
    return angle + (tangent + (tangent * _sum_powers(_ARCTAN, tangent * tangent) + angle_rest))


def arctan(tangent: _Real) -> _Real:
    """Arctangent, -pi / 2 to pi / 2."""
    return arctan2(tangent, 1.0)


def arcsin(sine: _Real) -> _Real:
    """Arcsine, -pi / 2 to pi / 2; domain: -1 to 1."""
    angle: _Real = arctan2(sine, _root((1.0 - sine) * (1.0 + sine)))
    return angle


def arccos(cosine: _Real) -> _Real:
    """Arccosine, 0 to pi; domain: -1 to 1."""
    angle: _Real = arctan2(_root((1.0 - cosine) * (1.0 + cosine)), cosine)
    return angle


def _root(x: Any) -> Any:
    return math.sqrt(x) if isinstance(x, float | int) else np.sqrt(x)


# Between these a sum of squares neither overflows nor loses digits.
_SQUARABLE = (1e-140, 1e140)


@overload
def hypot(x: float, y: float, /, *more: float) -> float: ...
@overload
def hypot(x: Floats, y: Floats | float, /, *more: Floats) -> Floats: ...
@overload
def hypot(x: float, y: Floats, /, *more: Floats) -> Floats: ...
def hypot(*parts: Any) -> Any:
    """Root of the sum of squares."""
    if all(isinstance(part, float | int) for part in parts):
        largest = max(map(abs, parts), default=0.0)
        if _SQUARABLE[0] < largest < _SQUARABLE[1] or not 0.0 < largest < math.inf:
            return math.sqrt(_sum_squares(parts))
        exponent = math.frexp(largest)[1]
        scaled = [math.ldexp(part, -exponent) for part in parts]
        return math.ldexp(math.sqrt(_sum_squares(scaled)), exponent)
    with np.errstate(under="ignore", over="ignore"):
        length = np.asarray(np.sqrt(_sum_squares(parts)))
        is_rough = ~((length > _SQUARABLE[0]) & (length < _SQUARABLE[1]))
        if is_rough.any():
            rough = [part[is_rough] for part in np.broadcast_arrays(*parts)]
            exponents = np.frexp(np.max(np.abs(rough), axis=0))[1]
            roots = np.sqrt(_sum_squares([np.ldexp(part, -exponents) for part in rough]))
            length[is_rough] = np.ldexp(roots, exponents)
    return length


def _sum_squares(parts: Any) -> Any:
    total = 0.0
    for part in parts:
        total = total + part * part
    return total


def exp(x: _Real) -> _Real:
    """Exponential."""
    # Beyond, results are 0 or infinite.
    if isinstance(x, float | int):
        held = min(max(float(x), -746.0), 710.0)
        power_of_two = round(held / math.log(2.0))
        return math.ldexp(_exp_of_rest(held, power_of_two), power_of_two)
    with np.errstate(under="ignore"):
        clipped = np.clip(np.asarray(x, dtype=np.float64), -746.0, 710.0)
        powers = np.fmin(np.rint(clipped / math.log(2.0)), 1025.0)
        raised: Floats = np.ldexp(_exp_of_rest(clipped, powers), powers.astype(np.int32))
        return raised


def _exp_of_rest(x: Any, power_of_two: Any) -> Any:
    near = x - power_of_two * _LN2[0]
    far = power_of_two * _LN2[1]
    rest = near - far
    return 1.0 + (rest + (rest * _sum_powers(_EXP, rest) - ((rest - near) + far)))


def ln(x: _Real) -> _Real:
    """Natural logarithm; -inf of 0, not a number below."""
    if isinstance(x, float | int):
        if not 0.0 < x < math.inf:
            return x if x > 0.0 else -math.inf if x == 0.0 else math.nan
        fraction, exponent = math.frexp(x)
        doubled = fraction < math.sqrt(0.5)
        logarithm: float = _log_of_parts(fraction * (1.0 + doubled), exponent - doubled)
        return logarithm
    values = np.asarray(x, dtype=np.float64)
    inside = (values > 0.0) & (values < math.inf)
    fractions, exponents = np.frexp(np.where(inside, values, 1.0))
    is_small = fractions < math.sqrt(0.5)
    with np.errstate(under="ignore"):
        logs = _log_of_parts(fractions * (1.0 + is_small), exponents - 1.0 * is_small)
    outside = np.where(values > 0.0, values, np.where(values == 0.0, -math.inf, math.nan))
    return np.where(inside, logs, outside)


def _log_of_parts(fraction: Any, exponent: Any) -> Any:
    """Logarithm of a fraction, sqrt(1/2) to sqrt(2), times a power of two."""
    over = fraction - 1.0
    ratio = over / (2.0 + over)
    half = 0.5 * over * over
    series = ratio * (half + _sum_powers(_LOG, ratio * ratio)) + exponent * _LN2[1]
    return exponent * _LN2[0] - ((half - series) - over)


def power(base: _Real, exponent: float) -> _Real:
    """Power of a base of at least 0, for exponents that are no small integers."""
    return exp(exponent * ln(base))


def interpolate_linear(x: Floats, knots: Floats, values: Floats) -> Floats:
    """Linear interpolation between increasing knots; beyond them the value at the nearer end."""
    held = np.clip(x, knots[0], knots[-1])
    i = np.clip(np.searchsorted(knots, held, side="right") - 1, 0, len(knots) - 2)
    slopes = (values[i + 1] - values[i]) / (knots[i + 1] - knots[i])
    return np.where(held >= knots[-1], values[-1], values[i] + slopes * (held - knots[i]))


# Longer sums are NumPy's, pairwise.
_MAX_TERMS = 8


def dot(a: npt.NDArray[_FloatT], b: npt.NDArray[_FloatT]) -> npt.NDArray[_FloatT]:
    """Sums over the last axis of products, (...)."""
    if a.shape[-1] > _MAX_TERMS:
        return np.asarray((a * b).sum(axis=-1))
    total = a[..., 0] * b[..., 0]
    for i in range(1, a.shape[-1]):
        total += a[..., i] * b[..., i]
    return total


def einsum(
    subscripts: str, a: npt.NDArray[_FloatT], b: npt.NDArray[_FloatT]
) -> npt.NDArray[_FloatT]:
    """Sums over one index of products, as `numpy.einsum` names the axes of two arrays."""
    names, kept = subscripts.split("->")
    order = kept + next(letter for letter in names if letter not in kept + ",")
    aligned = []
    for array, letters in zip((a, b), names.split(","), strict=True):
        moved = array.transpose([letters.index(letter) for letter in order if letter in letters])
        aligned.append(moved[tuple(slice(None) if one in letters else None for one in order)])
    return dot(*aligned)


def matmul(a: npt.NDArray[_FloatT], b: npt.NDArray[_FloatT]) -> npt.NDArray[_FloatT]:
    """Product of matrices or vectors, as `a @ b`."""
    if a.ndim <= 2 >= b.ndim and a.size <= 9 >= b.size and len(b) == 3:
        return _multiply_small(a, b)
    if b.ndim == 1:
        return dot(a, b)
    if b.shape[-2] > _MAX_TERMS:
        return np.asarray(
            (a[..., :, None] * (b if b.ndim == 2 else b[..., None, :, :])).sum(axis=-2)
        )
    rows = b if b.ndim == 2 else np.moveaxis(b, -2, 0)[..., None, :]
    total: npt.NDArray[_FloatT] = a[..., 0, None] * rows[0]
    for i in range(1, len(rows)):
        total += a[..., i, None] * rows[i]
    return total


def _multiply_small(a: npt.NDArray[_FloatT], b: npt.NDArray[_FloatT]) -> npt.NDArray[_FloatT]:
    """Product of sums of three terms: in a third of the time of NumPy's calls."""
    rows, columns = a.reshape(-1, 3).tolist(), b.reshape(3, -1).T.tolist()
    entries = [x * p + y * q + z * r for x, y, z in rows for p, q, r in columns]
    return np.array(entries, dtype=a.dtype).reshape(a.shape[:-1] + b.shape[1:])


def solve_linear(matrices: Floats, right: Floats) -> Floats:
    """Solutions, (..., n, m), of linear systems with matrices (..., n, n), by Gauss and Jordan.

    A singular matrix divides by zero, as `numpy.errstate` has it.
    """
    n = matrices.shape[-1]
    rows = np.concatenate((matrices, right), axis=-1)
    for i in range(n):
        place = i + np.argmax(np.abs(rows[..., i:, i]), axis=-1)[..., None, None]
        pivot = np.take_along_axis(rows, place, axis=-2)
        np.put_along_axis(rows, place, rows[..., i, None, :], axis=-2)
        pivot = pivot / pivot[..., i, None]
        rows -= rows[..., i, None] * pivot
        rows[..., i, :] = pivot[..., 0, :]
    return rows[..., n:]
