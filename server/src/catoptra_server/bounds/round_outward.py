"""Bounds rounded outward, to eighths of an octave, so that a robot that drives changes them rarely.

What is decided by them is then decided once for many frames. It costs at most 9 % of a bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from catoptra_server.scene.twist import Twist, Vector3

_STEPS_PER_OCTAVE = 8
_STEPS_PER_VECTOR = 16
# A bound of no distance at all would leave quotients by it without a value.
MIN_DISTANCE_M = 1e-6
# A nanometre a second is rounding; rounded up, its sign would make another bound of it.
_MIN_RATE = 1e-9


def round_down(distances_m: Iterable[float]) -> tuple[float, ...]:
    """Return distances rounded down, none below NEAREST_M."""
    return tuple(map(_round_value_down, distances_m))


def round_away_from_zero(values: Iterable[float]) -> tuple[float, ...]:
    """Return rates rounded away from zero."""
    return tuple(map(_round_value_away, values))


def round_twist(twist: Twist) -> Twist:
    """Return a motion with each component rounded away from zero, by a share of its vector."""
    return Twist(_round_vector(twist.linear_m_s), _round_vector(twist.angular_rad_s))


def _round_vector(values: Vector3) -> Vector3:
    length = math.hypot(*values)
    if length < _MIN_RATE:
        return 0.0, 0.0, 0.0
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
