"""Wheel speeds from the robot's true pose to a waypoint.

The controller stands for the people who drove the paper's robots. It reads the true pose, which the
filter never does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.route import Waypoint

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
    """Command for the arc to a waypoint, or for the turn to its heading where it is reached."""
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
