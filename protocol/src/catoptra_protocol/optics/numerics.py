"""Array types and angle arithmetic of the camera models and the filter."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError

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
