"""Outward rounding of bounds to eighths of an octave.

A driving robot then changes the bounds rarely, and a decision made from them holds for many frames.
Rounding costs at most 9 % of a bound (2^(1/8) = 1.09).
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from catoptra_server.world.world_description import Twist, Vector3

# Criteria divide by distances.
MIN_DISTANCE_M = 1e-6


def round_down(distances_m: Iterable[float]) -> tuple[float, ...]:
    """Distances rounded down, none below MIN_DISTANCE_M."""
    return tuple(map(_round_value_down, distances_m))


def round_away_from_zero(values: Iterable[float]) -> tuple[float, ...]:
    """Rates rounded away from zero."""
    return tuple(map(_round_value_away, values))


def round_twist(twist: Twist) -> Twist:
    """Twist with each component rounded away from zero, in sixteenths of the vector's octave."""
    return Twist(_round_vector(twist.linear_m_s), _round_vector(twist.angular_rad_s))


_STEPS_PER_OCTAVE = 8
_STEPS_PER_VECTOR = 16

# Below a nanometre a second there is only rounding, whose changing sign would change the bound.
_MIN_RATE = 1e-9


def _round_vector(values: Vector3) -> Vector3:
    length = math.hypot(*values)
    if length < _MIN_RATE:
        return 0.0, 0.0, 0.0
    # Steps of the whole vector, not of each component: a component near zero would otherwise pass
    # through many octaves.
    step = math.ldexp(1.0, math.frexp(length)[1]) / _STEPS_PER_VECTOR
    x, y, z = (
        math.copysign(step * math.ceil(abs(v) / step), v) if abs(v) >= _MIN_RATE else 0.0
        for v in values
    )
    return x, y, z


def _round_value_down(value: float) -> float:
    if math.isinf(value):
        return value
    eighths = math.floor(_STEPS_PER_OCTAVE * math.log2(max(value, MIN_DISTANCE_M)))
    return max(math.exp2(eighths / _STEPS_PER_OCTAVE), MIN_DISTANCE_M)


def _round_value_away(value: float) -> float:
    if math.isinf(value):
        return value
    if abs(value) < _MIN_RATE:
        return 0.0
    eighths = math.ceil(_STEPS_PER_OCTAVE * math.log2(abs(value)))
    return math.copysign(math.exp2(eighths / _STEPS_PER_OCTAVE), value)
