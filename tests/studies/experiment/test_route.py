"""The route has the paper's shape; wheel speeds lead to its waypoints by the server's arc model."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_client.localization import Control
from catoptra_client.localization.motion_model import propagate_pose
from catoptra_studies.experiment.route import (
    Chassis,
    Waypoint,
    clockwise_route,
    counter_clockwise_route,
    wheel_command_towards,
)


@pytest.mark.parametrize("route", [clockwise_route(), counter_clockwise_route()])
def test_route_returns_to_its_start_before_the_diagonal_to_the_opposite_corner(route):
    assert len(route) == 101
    start, back = route[0], route[84]
    assert (back.x_m, back.y_m) == pytest.approx((start.x_m, start.y_m), abs=1e-12)
    assert math.cos(back.yaw_rad - start.yaw_rad) == pytest.approx(1.0, abs=1e-12)
    assert (route[-1].x_m, route[-1].y_m) == pytest.approx((-start.x_m, -start.y_m))


def test_first_corner_is_reached_with_step_23():
    route = clockwise_route()
    assert route[23].yaw_rad == pytest.approx(0.0)
    assert route[24].yaw_rad == pytest.approx(math.pi / 4)


def test_direction_of_turning_is_clockwise_as_seen_from_above():
    # SAE: yaw grows clockwise; the first turn of the clockwise route is to the right.
    assert clockwise_route()[24].yaw_rad > 0.0
    route = counter_clockwise_route()
    assert math.sin(route[24].yaw_rad - route[23].yaw_rad) < 0.0


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
