"""The route round the field: along the edges, then across, in 100 steps as in the paper.

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
    """Pose of the robot after a step."""

    x_m: float
    y_m: float

    yaw_rad: float
    """Heading, clockwise from the x axis as seen from above."""

    def advance(self, distance_m: float) -> Waypoint:
        """Waypoint straight ahead."""
        x_m = self.x_m + distance_m * math.cos(self.yaw_rad)
        y_m = self.y_m + distance_m * math.sin(self.yaw_rad)
        return Waypoint(x_m, y_m, self.yaw_rad)

    def turn(self, angle_rad: float) -> Waypoint:
        """Waypoint after a turn on the spot, clockwise."""
        return Waypoint(self.x_m, self.y_m, wrap_angle(self.yaw_rad + angle_rad))


def clockwise_route() -> tuple[Waypoint, ...]:
    """Start and 100 waypoints of the paper's real drive, clockwise from the lower left corner."""
    return _build_route(Waypoint(-HALF_LENGTH_M, -HALF_WIDTH_M, 0.0), turn_sign=1.0)


def counter_clockwise_route() -> tuple[Waypoint, ...]:
    """Start and 100 waypoints of the simulated drive, from the other end and the other way."""
    return _build_route(Waypoint(HALF_LENGTH_M, -HALF_WIDTH_M, math.pi), turn_sign=-1.0)


def _build_route(start: Waypoint, *, turn_sign: float) -> tuple[Waypoint, ...]:
    # 23 + 2 + 15 + 2 steps, twice, then the turn and 15 across: 100 in all.
    route = [start]
    for side_m in (2 * HALF_LENGTH_M, 2 * HALF_WIDTH_M) * 2:
        for _ in range(round(side_m / STEP_LENGTH_M)):
            route.append(route[-1].advance(STEP_LENGTH_M))
        for _ in range(2):
            route.append(route[-1].turn(turn_sign * math.pi / 4))
    route.append(route[-1].turn(turn_sign * math.atan2(HALF_WIDTH_M, HALF_LENGTH_M)))
    diagonal_m = 2 * math.hypot(HALF_LENGTH_M, HALF_WIDTH_M)
    # Steps of 0.37 m across, twice as long as along the sides, to make 100 in all.
    for _ in range(NUM_DIAGONAL_STEPS):
        route.append(route[-1].advance(diagonal_m / NUM_DIAGONAL_STEPS))
    return tuple(route)
