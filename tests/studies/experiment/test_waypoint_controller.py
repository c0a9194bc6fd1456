"""Wheel speeds lead to the waypoint, by the arc model of the server's drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization import Control
from catoptra_client.localization.motion_model import propagate_pose
from catoptra_studies.experiment.route import Chassis, Waypoint, wheel_command_towards

P2AT = Chassis(wheel_radius_m=0.13, wheel_separation_m=0.4712, max_speed_rad_s=5.385)
HERE = Waypoint(1.0, -0.5, 0.7)


def drive_to(here: Waypoint, target: Waypoint) -> np.ndarray:
    """(3,) pose after the command, without slip."""
    command = wheel_command_towards(target, here, P2AT)
    left = command.left_rad_s * command.duration_s * P2AT.wheel_radius_m
    right = command.right_rad_s * command.duration_s * P2AT.wheel_radius_m
    control = Control(0.5 * (left + right), (left - right) / P2AT.wheel_separation_m)
    return propagate_pose(np.array([here.x_m, here.y_m, here.yaw_rad]), control)


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, -30.0, 80.0])
def test_arc_ends_at_the_waypoint(angle_deg):
    heading = HERE.yaw_rad + math.radians(angle_deg)
    target = Waypoint(HERE.x_m + 0.2 * math.cos(heading), HERE.y_m + 0.2 * math.sin(heading), 0.0)
    assert drive_to(HERE, target)[:2] == pytest.approx([target.x_m, target.y_m], abs=1e-9)


@pytest.mark.parametrize("turn_deg", [45.0, -45.0, 170.0, 0.0])
def test_reached_waypoint_is_turned_towards(turn_deg):
    target = HERE.turn(math.radians(turn_deg))
    end = drive_to(HERE, target)
    assert end[:2] == pytest.approx([HERE.x_m, HERE.y_m], abs=1e-9)
    assert math.cos(end[2] - target.yaw_rad) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("distance_m", [0.06, 0.2, 0.366, 3.0])
def test_wheels_stay_below_their_top_speed(distance_m):
    command = wheel_command_towards(HERE.advance(distance_m), HERE, P2AT)
    assert max(abs(command.left_rad_s), abs(command.right_rad_s)) <= P2AT.max_speed_rad_s
    assert command.duration_s >= 0.02
