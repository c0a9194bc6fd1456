"""Directions as half-angle tangents t = tan(theta / 2), theta the angle from the axis +z."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats

_MIN_NORMAL = float(np.finfo(np.float64).tiny)


@np.errstate(under="ignore")  # terms far below the largest component may vanish
def half_angle_tangent(direction: Floats) -> tuple[Floats, Bools]:
    """t = tan(theta / 2) of (..., 3) directions in the mirror frame, and where t is finite.

    Invalid, with the value 0: the zero vector, the antipode, directions that are not finite, and
    directions nearer to the antipode than 1e-308 rad.
    """
    x, y, z = scale_components(direction)
    return half_angle_tangent_from_rho_z(np.hypot(x, y), z)


def half_angle_tangent_from_rho_z(rho: Floats, z: Floats) -> tuple[Floats, Bools]:
    """t of directions at distance rho from the axis and height z, and a validity mask."""
    norm = np.hypot(rho, z)
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
