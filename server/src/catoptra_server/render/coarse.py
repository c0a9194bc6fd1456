"""Bounds rounded outward, to eighths of an octave, so that a robot that drives changes them rarely.

What is decided by them is then decided once for many frames. It costs at most 9 % of a bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from catoptra_server.scene.motion import Twist, Vector

_STEPS_AN_OCTAVE = 8
_STEPS_A_VECTOR = 16
# A bound of no distance at all would leave quotients by it without a value.
NEAREST_M = 1e-6
# A nanometre a second is rounding; rounded up, its sign would make another bound of it.
_REST = 1e-9


def down(distances_m: Iterable[float]) -> tuple[float, ...]:
    """Return distances rounded down, none below NEAREST_M."""
    return tuple(map(_down, distances_m))


def up(rates: Iterable[float]) -> tuple[float, ...]:
    """Return rates rounded away from zero."""
    return tuple(map(_up, rates))


def twist(motion: Twist) -> Twist:
    """Return a motion with each component rounded away from zero, by a share of its vector."""
    return Twist(_vector(motion.linear_m_s), _vector(motion.angular_rad_s))


def _vector(values: Vector) -> Vector:
    length = math.hypot(*values)
    if length < _REST:
        return 0.0, 0.0, 0.0
    step = math.ldexp(1.0, math.frexp(length)[1]) / _STEPS_A_VECTOR
    x, y, z = (
        math.copysign(step * math.ceil(abs(v) / step), v) if abs(v) >= _REST else 0.0
        for v in values
    )
    return x, y, z


def _down(value: float) -> float:
    if math.isinf(value):
        return value
    eighths = math.floor(_STEPS_AN_OCTAVE * math.log2(max(value, NEAREST_M)))
    return max(math.exp2(eighths / _STEPS_AN_OCTAVE), NEAREST_M)


def _up(value: float) -> float:
    if math.isinf(value):
        return value
    if abs(value) < _REST:
        return 0.0
    eighths = math.ceil(_STEPS_AN_OCTAVE * math.log2(abs(value)))
    return math.copysign(math.exp2(eighths / _STEPS_AN_OCTAVE), value)
