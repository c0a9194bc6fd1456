"""The way round the field: along its edges, then across, in 100 steps, as the paper's robots drove.

A rectangle of 4.6 x 3.0 m in steps of 0.2 m, long side first, each corner in two turns of 45
degrees; then a turn towards the opposite corner and the diagonal in 15 steps. World frame: SAE, x
along the field, y to its right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.optics.numerics import wrap_angle

HALF_LENGTH_M = 2.3
HALF_WIDTH_M = 1.5
STEP_LENGTH_M = 0.2
NUM_DIAGONAL_STEPS = 15


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Where the robot should stand after a step: x, y in metres, yaw in radians."""

    x_m: float
    y_m: float
    yaw_rad: float

    def advance(self, distance_m: float) -> Waypoint:
        """Return the waypoint this far ahead."""
        x = self.x_m + distance_m * math.cos(self.yaw_rad)
        y = self.y_m + distance_m * math.sin(self.yaw_rad)
        return Waypoint(x, y, self.yaw_rad)

    def turn(self, angle_rad: float) -> Waypoint:
        """Return the waypoint turned clockwise on the spot."""
        return Waypoint(self.x_m, self.y_m, wrap_angle(self.yaw_rad + angle_rad))


def clockwise_route() -> tuple[Waypoint, ...]:
    """Return start and 100 waypoints of the paper's real run: from the lower left, clockwise."""
    return _build_route(Waypoint(-HALF_LENGTH_M, -HALF_WIDTH_M, 0.0), turn_sign=1.0)


def counter_clockwise_route() -> tuple[Waypoint, ...]:
    """Return start and 100 waypoints of the simulated run: from the other end, the other way."""
    return _build_route(Waypoint(HALF_LENGTH_M, -HALF_WIDTH_M, math.pi), turn_sign=-1.0)


def _build_route(start: Waypoint, *, turn_sign: float) -> tuple[Waypoint, ...]:
    way = [start]
    for side_m in (2 * HALF_LENGTH_M, 2 * HALF_WIDTH_M) * 2:
        for _ in range(round(side_m / STEP_LENGTH_M)):
            way.append(way[-1].advance(STEP_LENGTH_M))
        for _ in range(2):
            way.append(way[-1].turn(turn_sign * math.pi / 4))
    way.append(way[-1].turn(turn_sign * math.atan2(HALF_WIDTH_M, HALF_LENGTH_M)))
    diagonal_m = 2 * math.hypot(HALF_LENGTH_M, HALF_WIDTH_M)
    for _ in range(NUM_DIAGONAL_STEPS):
        way.append(way[-1].advance(diagonal_m / NUM_DIAGONAL_STEPS))
    return tuple(way)
