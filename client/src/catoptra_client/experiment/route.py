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
STEP_M = 0.2
DIAGONAL_STEPS = 15


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Where the robot should stand after a step: x, y in metres, yaw in radians."""

    x_m: float
    y_m: float
    yaw_rad: float

    def ahead(self, distance_m: float) -> Waypoint:
        """Return the waypoint this far ahead."""
        x = self.x_m + distance_m * math.cos(self.yaw_rad)
        y = self.y_m + distance_m * math.sin(self.yaw_rad)
        return Waypoint(x, y, self.yaw_rad)

    def turned(self, angle_rad: float) -> Waypoint:
        """Return the waypoint turned clockwise on the spot."""
        return Waypoint(self.x_m, self.y_m, wrap_angle(self.yaw_rad + angle_rad))


def clockwise_route() -> tuple[Waypoint, ...]:
    """Return start and 100 waypoints of the paper's real run: from the lower left, clockwise."""
    return _route(Waypoint(-HALF_LENGTH_M, -HALF_WIDTH_M, 0.0), turn=1.0)


def counter_clockwise_route() -> tuple[Waypoint, ...]:
    """Return start and 100 waypoints of the simulated run: from the other end, the other way."""
    return _route(Waypoint(HALF_LENGTH_M, -HALF_WIDTH_M, math.pi), turn=-1.0)


def _route(start: Waypoint, *, turn: float) -> tuple[Waypoint, ...]:
    way = [start]
    for side_m in (2 * HALF_LENGTH_M, 2 * HALF_WIDTH_M) * 2:
        for _ in range(round(side_m / STEP_M)):
            way.append(way[-1].ahead(STEP_M))
        for _ in range(2):
            way.append(way[-1].turned(turn * math.pi / 4))
    way.append(way[-1].turned(turn * math.atan2(HALF_WIDTH_M, HALF_LENGTH_M)))
    diagonal_m = 2 * math.hypot(HALF_LENGTH_M, HALF_WIDTH_M)
    for _ in range(DIAGONAL_STEPS):
        way.append(way[-1].ahead(diagonal_m / DIAGONAL_STEPS))
    return tuple(way)
