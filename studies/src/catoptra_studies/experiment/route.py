"""The route round the field in 100 steps as in the paper, and the wheel speeds that drive it.

A rectangle of 4.6 x 3.0 m in steps of 0.2 m, long side first, each corner in two turns of 45
degrees; then a turn towards the opposite corner and the diagonal in 15 steps. World frame: SAE, x
along the field, y to its right. The controller stands for the people who drove the paper's robots
and reads the true pose, which the filter never does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.optics.numerics import wrap_angle

_HALF_LENGTH_M = 2.3
_HALF_WIDTH_M = 1.5
_STEP_LENGTH_M = 0.2
_NUM_DIAGONAL_STEPS = 15


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
    return _build_route(Waypoint(-_HALF_LENGTH_M, -_HALF_WIDTH_M, 0.0), turn_sign=1.0)


def counter_clockwise_route() -> tuple[Waypoint, ...]:
    """Start and 100 waypoints of the simulated drive, from the other end and the other way."""
    return _build_route(Waypoint(_HALF_LENGTH_M, -_HALF_WIDTH_M, math.pi), turn_sign=-1.0)


def _build_route(start: Waypoint, *, turn_sign: float) -> tuple[Waypoint, ...]:
    # 23 + 2 + 15 + 2 steps, twice, then the turn and 15 across: 100 in all.
    route = [start]
    for side_m in (2 * _HALF_LENGTH_M, 2 * _HALF_WIDTH_M) * 2:
        for _ in range(round(side_m / _STEP_LENGTH_M)):
            route.append(route[-1].advance(_STEP_LENGTH_M))
        for _ in range(2):
            route.append(route[-1].turn(turn_sign * math.pi / 4))
    route.append(route[-1].turn(turn_sign * math.atan2(_HALF_WIDTH_M, _HALF_LENGTH_M)))
    diagonal_m = 2 * math.hypot(_HALF_LENGTH_M, _HALF_WIDTH_M)
    # Steps of 0.37 m across, twice as long as along the sides, to make 100 in all.
    for _ in range(_NUM_DIAGONAL_STEPS):
        route.append(route[-1].advance(diagonal_m / _NUM_DIAGONAL_STEPS))
    return tuple(route)


# A nearer waypoint counts as reached, and the rest of the step is a turn on the spot: an arc to a
# point so close would begin with a sharp turn.
_POSITION_TOLERANCE_M = 0.05
_TICK_S = 0.02
_MAX_SPEED_FRACTION = 0.8


@dataclass(frozen=True, slots=True)
class Chassis:
    """Dimensions of the robot that the controller needs."""

    wheel_radius_m: float

    wheel_separation_m: float
    """Distance between the left and the right wheels."""

    max_speed_rad_s: float
    """Largest speed of a wheel."""


@dataclass(frozen=True, slots=True)
class WheelCommand:
    """Wheel speeds held for a time."""

    left_rad_s: float
    right_rad_s: float
    duration_s: float


def wheel_command_towards(target: Waypoint, pose: Waypoint, chassis: Chassis) -> WheelCommand:
    """Command for the arc to a waypoint, or for the turn to the heading at a reached waypoint."""
    dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
    chord_m = math.hypot(dx, dy)
    if chord_m < _POSITION_TOLERANCE_M:
        return _arc_command(0.0, wrap_angle(target.yaw_rad - pose.yaw_rad), chassis)
    # An arc tangent to the heading turns by twice the angle between heading and chord.
    half_turn = wrap_angle(math.atan2(dy, dx) - pose.yaw_rad)
    arc_m = chord_m * half_turn / math.sin(half_turn) if abs(half_turn) > 1e-9 else chord_m
    return _arc_command(arc_m, 2.0 * half_turn, chassis)


def _arc_command(distance_m: float, turn_rad: float, chassis: Chassis) -> WheelCommand:
    """Command for an arc, at four fifths of the wheels' largest speed."""
    swing_m = 0.5 * turn_rad * chassis.wheel_separation_m
    left_rad = (distance_m + swing_m) / chassis.wheel_radius_m
    right_rad = (distance_m - swing_m) / chassis.wheel_radius_m
    speed_rad_s = _MAX_SPEED_FRACTION * chassis.max_speed_rad_s
    duration_s = max(abs(left_rad), abs(right_rad), 1e-6) / speed_rad_s
    # Whole ticks of the simulation, at least one: a command cannot end between two.
    duration_s = max(_TICK_S, math.ceil(duration_s / _TICK_S) * _TICK_S)
    return WheelCommand(left_rad / duration_s, right_rad / duration_s, duration_s)
