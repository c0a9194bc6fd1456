"""The operator who drives the robot by sight: wheel speeds from where it is to a waypoint.

It stands for the person who drove the paper's robots. It sees the true pose; the filter never does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.route import Waypoint

# Nearer than this a waypoint is reached: what is left is a turn on the spot.
_POSITION_TOLERANCE_M = 0.05


@dataclass(frozen=True, slots=True)
class Chassis:
    """What the operator knows of the robot: wheel radius and separation in metres, top speed."""

    wheel_radius_m: float
    wheel_separation_m: float
    max_speed_rad_s: float


@dataclass(frozen=True, slots=True)
class WheelCommand:
    """Wheel speeds in rad/s, to be held for a time."""

    left_rad_s: float
    right_rad_s: float
    duration_s: float


def wheel_command_towards(target: Waypoint, pose: Waypoint, chassis: Chassis) -> WheelCommand:
    """Return the arc to a waypoint, or the turn on the spot to its heading if it is reached."""
    dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
    chord_m = math.hypot(dx, dy)
    if chord_m < _POSITION_TOLERANCE_M:
        return _arc_command(0.0, wrap_angle(target.yaw_rad - pose.yaw_rad), chassis)
    half_turn = wrap_angle(math.atan2(dy, dx) - pose.yaw_rad)
    arc_m = chord_m * half_turn / math.sin(half_turn) if abs(half_turn) > 1e-9 else chord_m
    return _arc_command(arc_m, 2.0 * half_turn, chassis)


def _arc_command(distance_m: float, turn_rad: float, chassis: Chassis) -> WheelCommand:
    """Return the wheel speeds for an arc, as fast as four fifths of the motor's speed allow."""
    swing_m = 0.5 * turn_rad * chassis.wheel_separation_m
    left_rad = (distance_m + swing_m) / chassis.wheel_radius_m
    right_rad = (distance_m - swing_m) / chassis.wheel_radius_m
    duration_s = max(abs(left_rad), abs(right_rad), 1e-6) / (0.8 * chassis.max_speed_rad_s)
    # A tick of the simulation is the shortest command that it can hold.
    duration_s = max(0.02, math.ceil(duration_s / 0.02) * 0.02)
    return WheelCommand(left_rad / duration_s, right_rad / duration_s, duration_s)
