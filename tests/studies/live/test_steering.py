"""An ideal robot completes laps, from anywhere; viewers take the robot and give it back."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.experiment_setups import SETUPS
from catoptra_studies.experiment.route import Chassis, Waypoint, counter_clockwise_route
from catoptra_studies.live.steering import (
    RESUME_AFTER_S,
    RouteProgress,
    SharedControl,
    advance_progress,
    observe_speeds,
    record_command,
    rejoin_route,
    skip_waypoints,
    steer,
)

CHASSIS = Chassis(wheel_radius_m=0.13, wheel_separation_m=0.47, max_speed_rad_s=3.2)
ROUTE = counter_clockwise_route()
CYCLE_S = 0.2


def move(pose: Waypoint, left_rad_s: float, right_rad_s: float, duration_s: float) -> Waypoint:
    """Pose after an exact arc."""
    radius, separation = CHASSIS.wheel_radius_m, CHASSIS.wheel_separation_m
    turn_rad = radius * (left_rad_s - right_rad_s) / separation * duration_s
    distance_m = 0.5 * radius * (left_rad_s + right_rad_s) * duration_s
    yaw_rad = pose.yaw_rad + 0.5 * turn_rad
    return Waypoint(
        pose.x_m + distance_m * math.cos(yaw_rad),
        pose.y_m + distance_m * math.sin(yaw_rad),
        wrap_angle(pose.yaw_rad + turn_rad),
    )


def drive_lap(
    pose: Waypoint, progress: RouteProgress, *, route=ROUTE, cycle_s: float = CYCLE_S
) -> list[Waypoint]:
    """Poses until the next lap begins; fails after five minutes."""
    poses, lap = [pose], progress.num_laps + 1
    for _ in range(round(300.0 / cycle_s)):
        progress = advance_progress(progress, route, poses[-1])
        if progress.num_laps == lap:
            return poses
        command = steer(progress, route, poses[-1], CHASSIS, min_duration_s=cycle_s)
        poses.append(move(poses[-1], command.left_rad_s, command.right_rad_s, cycle_s))
    raise AssertionError(f"no lap in five minutes: at waypoint {progress.index}, {poses[-1]}")


@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.name)
@pytest.mark.parametrize("cycle_s", [0.05, 0.2, 0.4])
def test_lap_when_driven_passes_every_waypoint(setup, cycle_s):
    poses = drive_lap(setup.route[0], RouteProgress(), route=setup.route, cycle_s=cycle_s)
    for waypoint in setup.route:
        nearest_m = min(math.hypot(p.x_m - waypoint.x_m, p.y_m - waypoint.y_m) for p in poses)
        assert nearest_m < 0.15, waypoint
    # 20.7 m at 0.33 m/s, and turns by 8 x 45 and 33 degrees.
    assert cycle_s * len(poses) < 90.0


def test_second_lap_begins_where_the_first_ended():
    end = drive_lap(ROUTE[0], RouteProgress())[-1]
    poses = drive_lap(end, RouteProgress(0, 1))
    assert min(math.hypot(p.x_m - ROUTE[0].x_m, p.y_m - ROUTE[0].y_m) for p in poses) < 0.15


@pytest.mark.parametrize(
    "elsewhere",
    [Waypoint(0.0, 0.0, 1.0), Waypoint(-4.0, 3.0, -2.0), Waypoint(2.2, -1.5, 0.0), ROUTE[60]],
    ids=["centre", "off the field", "facing backwards", "on the route"],
)
def test_route_when_rejoined_from_elsewhere_is_completed(elsewhere):
    progress = rejoin_route(RouteProgress(3, 2), ROUTE, elsewhere)
    assert progress.num_laps == 2
    assert drive_lap(elsewhere, progress)


def test_rejoining_takes_the_nearest_waypoint():
    near = Waypoint(ROUTE[7].x_m, ROUTE[7].y_m + 0.05, 2.0)
    assert rejoin_route(RouteProgress(50, 1), ROUTE, near) == RouteProgress(7, 1)


def test_waypoints_when_skipped_past_the_end_begin_a_lap():
    assert skip_waypoints(RouteProgress(98, 4), ROUTE, 8) == RouteProgress(5, 5)


def test_short_arc_when_steered_takes_the_whole_cycle():
    pose = Waypoint(ROUTE[1].x_m + 0.12, ROUTE[1].y_m, ROUTE[1].yaw_rad)
    command = steer(RouteProgress(1), ROUTE, pose, CHASSIS, min_duration_s=2.0)
    assert command.duration_s == pytest.approx(2.0)
    reached = move(pose, command.left_rad_s, command.right_rad_s, 2.0)
    assert reached.x_m == pytest.approx(ROUTE[1].x_m)


def test_waypoint_to_the_side_when_steered_to_is_turned_to_on_the_spot():
    command = steer(
        RouteProgress(1), ROUTE, Waypoint(ROUTE[1].x_m, 0.0, 0.0), CHASSIS, min_duration_s=0.2
    )
    assert command.left_rad_s == pytest.approx(-command.right_rad_s)


STANDING = (0.0, 0.0)
OWN = (2.0, 2.5)
FOREIGN = (1.0, -1.0)
DRIVING = record_command(SharedControl(), OWN)


def test_own_commands_are_not_foreign_even_if_the_state_is_older():
    control = record_command(DRIVING, (2.1, 2.4))
    for speeds in (OWN, (2.1, 2.4), STANDING, (2.0004, 2.5)):
        assert not observe_speeds(control, speeds, 0.0).is_foreign


def test_recent_commands_are_limited():
    control = DRIVING
    for number in range(100):
        control = record_command(control, (float(number), 1.0))
    assert len(control.recent_speeds) == 4
    assert observe_speeds(control, OWN, 0.0).is_foreign


@pytest.mark.parametrize(
    ("observed", "is_foreign"),
    [
        ([(FOREIGN, float(time_s)) for time_s in range(100)], True),
        ([(FOREIGN, 10.0), (STANDING, 11.0), (STANDING, 10.9 + RESUME_AFTER_S)], True),
        ([(FOREIGN, 10.0), (STANDING, 11.0), (STANDING, 11.0 + RESUME_AFTER_S)], False),
        # Each command of the viewer begins the wait anew.
        ([*((FOREIGN, 10.0), (STANDING, 11.0), (FOREIGN, 13.0), (STANDING, 13.5)),
          (STANDING, 15.0)], True),
    ],
    ids=["driving at one speed", "just stopped", "stopped long ago", "stopped again"],
)  # fmt: skip
def test_viewer_keeps_the_robot_until_three_seconds_after_the_stop(observed, is_foreign):
    control = DRIVING
    for speeds, time_s in observed[:-1]:
        control = observe_speeds(control, speeds, time_s)
        assert control.is_foreign
    assert observe_speeds(control, *observed[-1]).is_foreign == is_foreign


def test_stop_by_a_viewer_holds_a_driving_robot():
    driving = SharedControl()
    for number in range(4):
        driving = record_command(driving, (2.0 + number, 2.0))
    control = observe_speeds(driving, STANDING, 5.0)
    assert control.is_foreign
    assert not observe_speeds(control, STANDING, 5.0 + RESUME_AFTER_S).is_foreign
