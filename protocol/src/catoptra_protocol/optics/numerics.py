"""Angles and the few series that the rest of the law leans on. Everything broadcasts."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

TWO_PI = 2.0 * math.pi


def wrap_angle(angle_rad: float) -> float:
    """Return the angle wrapped to (-pi, pi].

    The IEEE remainder is exact, so a wrap adds no error but that of 2 pi as a float: 4e-17 of the
    angle. It rounds half turns to even and so returns -pi for some of them; those are moved to +pi,
    the end of the interval that belongs to it. Raises DomainError for an angle that is not finite.
    """
    if not math.isfinite(angle_rad):
        raise DomainError(f"an angle must be finite to be wrapped: {angle_rad!r}")
    wrapped = math.remainder(angle_rad, TWO_PI)
    return math.pi if wrapped <= -math.pi else wrapped


def angle_difference(angle_rad: float, from_rad: float) -> float:
    """Return the turn in (-pi, pi] from one angle to another, the shorter way round.

    Both are wrapped first, so that turns of either do not round the difference away. Raises
    DomainError for angles that are not finite.
    """
    return wrap_angle(wrap_angle(angle_rad) - wrap_angle(from_rad))


def interpolate_angle(from_rad: float, to_rad: float, *, fraction: float) -> float:
    """Return the wrapped angle at a share of the shorter way: the mean of two angles at one half.

    Of opposite angles the way is to the right. Raises DomainError for angles that are not finite.
    """
    return wrap_angle(wrap_angle(from_rad) + fraction * angle_difference(to_rad, from_rad))
