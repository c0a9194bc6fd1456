"""Outward rounding of bounds to eighths of an octave, and of viewpoints to cells.

A driving robot then changes the bounds rarely, and a decision made from them holds for many frames.
Rounding costs at most 9 % of a bound (2^(1/8) = 1.09).

All viewpoints of a cell share a bound. Cells belong to fixed grids and do not depend on earlier
frames: a frame follows from its camera state alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable
from functools import lru_cache
from typing import Generic, TypeVar

import numpy as np

from catoptra_protocol.optics.numerics import Floats
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


_BoundT = TypeVar("_BoundT")
# Robots drive on floors: above one, a cell may be wide and must be low.
_CELL_HEIGHT_FRACTION = 0.125
# Side of a single viewpoint's cell, a nanometre: a camera on a robot rests in the robot's frame but
# for rounding. Under a thousandth of any distance that a bound has.
POINT_M = 2.0**-30
# 100 bytes an entry; a driving robot needs five new ones a second.
_CACHE_SIZE = 8192


class ViewpointCells(Generic[_BoundT]):
    """Bounds in cells of viewpoints, each evaluated once."""

    def __init__(self, sides_m: tuple[float, ...], evaluate: Callable[..., _BoundT | None]) -> None:
        """Evaluate nothing yet.

        Args:
            sides_m: Sides of cells, largest first. A viewpoint too near a surface for the smallest
                is evaluated in a cell of `POINT_M`: a robot would leave others in every frame.
            evaluate: Bound in a cell, of its (3,) centre and (3,) sides and of further keys; None
                for a cell too large for its surroundings, but for `POINT_M`.
        """
        self._sides_m = (*sides_m, POINT_M)
        self._evaluate = evaluate
        # Per instance: a cache on the class would keep scenes alive.
        self._find_cached = lru_cache(maxsize=_CACHE_SIZE)(self._find_in_cell)

    @property
    def num_evaluations(self) -> int:
        """Number of viewpoints and cells evaluated so far, for tests and measurements."""
        return self._find_cached.cache_info().misses

    def find(self, viewpoint: Floats, *keys: Hashable) -> _BoundT:
        """Bound in the largest cell around a (3,) viewpoint that has one."""
        x, y, z = viewpoint.tolist()
        for side in self._sides_m:
            cell = (round(x / side), round(y / side), round(z / (_CELL_HEIGHT_FRACTION * side)))
            found = self._find_cached(cell, side, *keys)
            if found is not None:
                return found
        raise AssertionError("a single viewpoint has a bound")

    def _find_in_cell(self, cell: Vector3, side: float, *keys: Hashable) -> _BoundT | None:
        sides = side * np.array((1.0, 1.0, _CELL_HEIGHT_FRACTION))
        return self._evaluate(sides * cell, sides, *keys)
