"""Array types, angles, half-angle tangents and domain checks of the camera models and the filter.

Directions are half-angle tangents t = tan(theta / 2), theta the angle from the axis +z: regular
from the axis to the antipode. Domain checks raise a DomainError that names the first invalid
element and carries the mask; they are for formulas without a value outside their domain. Functions
that take users' pixels and directions return a value and a mask instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.elementary import hypot

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

TWO_PI = 2.0 * math.pi


def wrap_angle(angle_rad: float) -> float:
    """Angle wrapped to (-pi, pi].

    The IEEE remainder is exact, so the only error is that of 2 pi as a float: 4e-17 of the angle.

    Raises:
        DomainError: the angle is not finite.
    """
    if not math.isfinite(angle_rad):
        raise DomainError(f"an angle must be finite to be wrapped: {angle_rad!r}")
    # The remainder rounds half turns to even and so returns -pi for some of them; the interval is
    # open there and contains +pi instead.
    wrapped = math.remainder(angle_rad, TWO_PI)
    return math.pi if wrapped <= -math.pi else wrapped


def angle_difference(angle_rad: float, from_rad: float) -> float:
    """Turn in (-pi, pi] from one angle to another, by the shorter direction.

    Raises:
        DomainError: an angle is not finite.
    """
    # Wrapped before the subtraction: whole turns in an angle would round the difference away.
    return wrap_angle(wrap_angle(angle_rad) - wrap_angle(from_rad))


def interpolate_angle(from_rad: float, to_rad: float, *, fraction: float) -> float:
    """Wrapped angle at a fraction of the shorter turn; the mean of two angles at one half.

    Between opposite angles the turn is to the right.

    Raises:
        DomainError: an angle is not finite.
    """
    return wrap_angle(wrap_angle(from_rad) + fraction * angle_difference(to_rad, from_rad))


_MIN_NORMAL = float(np.finfo(np.float64).tiny)


@np.errstate(under="ignore")  # terms far below the largest component may vanish
def half_angle_tangent(direction: Floats) -> tuple[Floats, Bools]:
    """t = tan(theta / 2) of (..., 3) directions in the mirror frame, and where t is finite.

    Invalid, with the value 0: the zero vector, the antipode, directions that are not finite, and
    directions nearer to the antipode than 1e-308 rad.
    """
    x, y, z = scale_components(direction)
    return half_angle_tangent_from_rho_z(hypot(x, y), z)


def half_angle_tangent_from_rho_z(rho: Floats, z: Floats) -> tuple[Floats, Bools]:
    """t of directions at distance rho from the axis and height z, and a validity mask."""
    norm = hypot(rho, z)
    # tan(theta / 2) = rho / (norm + z) = (norm - z) / rho: one form for each hemisphere, chosen so
    # that the sum or difference adds terms of one sign.
    lower = z >= 0.0
    numerator = np.where(lower, rho, norm - z)
    denominator = np.where(lower, norm + z, rho)
    # The numerator is at most 2: over a normal number the quotient is finite.
    valid = denominator >= _MIN_NORMAL
    return np.where(valid, numerator, 0.0) / np.where(valid, denominator, 1.0), valid


def scale_components(direction: Floats) -> tuple[Floats, Floats, Floats]:
    """x, y, z of (..., 3) directions, divided by the largest component so that squares stay finite.

    Zero where a direction is not finite.
    """
    direction = np.asarray(direction, dtype=np.float64)
    finite = np.isfinite(direction).all(axis=-1, keepdims=True)
    direction = np.where(finite, direction, 0.0)
    largest = np.abs(direction).max(axis=-1, keepdims=True)
    x, y, z = np.moveaxis(direction / np.where(largest > 0.0, largest, 1.0), -1, 0)
    return x, y, z


def require_domain(valid_mask: npt.ArrayLike, values: npt.ArrayLike, expected: str) -> None:
    """Raise DomainError unless every element lies in the domain.

    Args:
        valid_mask: (...) true inside the domain.
        values: (...) or (..., n) arguments of the formula, quoted in the message.
        expected: the domain, in words.

    Raises:
        DomainError: names the first invalid value with its index; `valid_mask` holds the mask.
    """
    mask = np.asarray(valid_mask, dtype=bool)
    # Fast path: these checks run for every sample of a frame, and almost always pass.
    if mask.all():
        return
    first = tuple(int(i) for i in np.unravel_index(np.argmin(mask), mask.shape))
    location = f" (element {', '.join(map(str, first))})" if first else ""
    value = np.asarray(values)[first].tolist()
    raise DomainError(f"{value}{location} is outside the domain: {expected}", mask)


def has_finite_square(values: npt.NDArray[np.floating[Any]]) -> Bools:
    """Mask of values small enough to be squared and summed.

    The bound is a quarter of the square root of the largest float: the sum of a few such squares is
    finite too.
    """
    limit = 0.25 * math.sqrt(float(np.finfo(np.asarray(values).dtype).max))
    return np.asarray(np.abs(values) <= limit)


@contextmanager
def reject_overflow(make_error: Callable[[str], CatoptraError]) -> Iterator[None]:
    """Raise an error of ours where numbers of others leave what can be computed with.

    For blocks that make a camera of a file or a message: single numbers pass every check, and their
    powers, quotients or roots do not exist.

    Args:
        make_error: Makes the error of a reason.
    """
    try:
        with np.errstate(over="raise", divide="raise", invalid="raise"):
            yield
    # NumPy's LinAlgError is a ValueError.
    except (ArithmeticError, ValueError) as error:
        reason = f"numbers of a possible camera; these cannot be computed with ({error})"
        raise make_error(reason) from error
