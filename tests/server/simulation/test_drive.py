"""Wheel spin to travel to pose: directions, limits, slip, arcs; a base at walls."""

from __future__ import annotations

import dataclasses
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import (
    MoveBase,
    RobotBody,
    WheelSpin,
    integrate_arc,
    step_body,
)
from catoptra_server.simulation.robot_description import DriveBase, PlanarPose
from helpers.robots import BASE, make_ground, make_walled_world

ORIGIN = PlanarPose(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [(10.0, -10.0, (5.0, -5.0)), (1.0, 2.0, (1.0, 2.0)), (math.inf, -math.inf, (5.0, -5.0))],
)
def test_spin_when_limited_saturates_each_side(
    left: float, right: float, expected: tuple[float, float]
) -> None:
    assert WheelSpin(left, right).limit_to(5.0) == WheelSpin(*expected)


@pytest.mark.parametrize("turn_rad", [0.0, 1e-300, 1e-12, 1e-8, 1e-3, 1.0, math.pi, 6.0, -2.0])
def test_arc_of_any_turn_ends_at_the_50_digit_reference(turn_rad: float) -> None:
    with mpmath.workdps(50):
        turn = mpmath.mpf(turn_rad)
        x = mpmath.sin(turn) / turn if turn_rad else mpmath.mpf(1)
        y = (1 - mpmath.cos(turn)) / turn if turn_rad else mpmath.mpf(0)
        expected = (float(2 * x), float(2 * y))
    end = integrate_arc(ORIGIN, 2.0, turn_rad)
    # Both forms have a few float64 roundings of 2 m.
    assert (end.x_m, end.y_m) == pytest.approx(expected, abs=2e-15)


def test_arc_cut_into_ticks_ends_at_the_same_pose() -> None:
    pose = ORIGIN
    for _ in range(1000):
        pose = integrate_arc(pose, 0.002, 0.003)
    whole = integrate_arc(ORIGIN, 2.0, 3.0)
    # A thousand roundings of 1e-16 each.
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx(
        (whole.x_m, whole.y_m, whole.yaw_rad), abs=1e-12
    )


@settings(derandomize=True, max_examples=100, deadline=None)
@given(
    st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(-math.pi, math.pi, exclude_min=True)
)
def test_arc_when_driven_back_returns(distance: float, turn: float, yaw: float) -> None:
    there = integrate_arc(PlanarPose(1.0, 2.0, yaw), distance, turn)
    back = integrate_arc(there, -distance, -turn)
    assert (back.x_m, back.y_m) == pytest.approx((1.0, 2.0), abs=1e-13)
    assert math.remainder(back.yaw_rad - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-14)
    assert -math.pi < there.yaw_rad <= math.pi


STREAM = RandomSource.from_names(1, "slip")
HALF_LENGTH_M = 0.5 * BASE.dimensions_m[0]
TICK_S = 0.02


def make_walls(*x_m: float) -> MoveBase:
    return make_ground(make_walled_world(*x_m)).move


def drive_for(body: RobotBody, ticks: int, move: MoveBase) -> RobotBody:
    for _ in range(ticks):
        body, _ = step_body(body, TICK_S, move=move, random_source=STREAM)
    return body


def make_body(
    x_m: float, yaw_rad: float = 0.0, *, left: float = 5.0, right: float = 5.0
) -> RobotBody:
    return stand_still(BASE, PlanarPose(x_m, 0.0, yaw_rad), WheelSpin(left, right))


def stand_still(base: DriveBase, pose: PlanarPose, spin: WheelSpin) -> RobotBody:
    return dataclasses.replace(RobotBody.on_floor(base, pose), spin=spin)


NOWHERE = make_ground().move


def drive_freely(base: DriveBase, left: float, right: float, *, ticks: int = 1) -> RobotBody:
    body = stand_still(base, ORIGIN, WheelSpin(left, right))
    return drive_for(body, ticks, NOWHERE)


def test_base_with_equal_spins_drives_straight() -> None:
    pose = drive_freely(BASE, 2.0, 2.0, ticks=100).pose
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == (pytest.approx(0.52, abs=1e-14), 0.0, 0.0)


@pytest.mark.parametrize("turn_slip", [0.0, 0.1])
def test_turn_when_left_is_faster_is_clockwise_but_for_the_slip(turn_slip: float) -> None:
    base = dataclasses.replace(BASE, turn_slip=turn_slip)
    body = stand_still(base, ORIGIN, WheelSpin(2.0, -1.0))
    after, travel = step_body(body, TICK_S, move=NOWHERE, random_source=STREAM)
    turn_rad = 3.0 * 0.13 * TICK_S / 0.4712
    # Encoders measure what the wheels roll; slip loses a part of the turn and no distance.
    assert travel.turn_rad(base) == pytest.approx(turn_rad, rel=1e-14)
    assert after.pose.yaw_rad == pytest.approx((1.0 - turn_slip) * turn_rad, rel=1e-12)
    assert math.hypot(after.pose.x_m, after.pose.y_m) == pytest.approx(0.065 * TICK_S, rel=1e-4)


@pytest.mark.parametrize("ticks", [10, 50])
def test_slip_noise_when_cut_into_ticks_has_the_same_spread(ticks: int) -> None:
    base = dataclasses.replace(BASE, slip_noise=0.02)
    spin = 1.0 / (ticks * 0.13 * TICK_S)
    body = stand_still(base, ORIGIN, WheelSpin(spin, spin))
    poses = [
        drive_for(dataclasses.replace(body, tick=run * ticks), ticks, NOWHERE).pose
        for run in range(400)
    ]
    # 2 cm of each side after 1 m; the spread of 400 runs is known to 3.5 % (one sigma).
    assert np.std([pose.yaw_rad for pose in poses]) == pytest.approx(
        0.02 * math.sqrt(2.0) / 0.4712, rel=0.12
    )
    assert np.mean([pose.x_m for pose in poses]) == pytest.approx(1.0, abs=0.004)
    assert np.std([pose.x_m for pose in poses]) == pytest.approx(0.02 / math.sqrt(2.0), rel=0.12)


@pytest.mark.parametrize("spin", [0.1, 1.0, 5.385])
def test_base_at_a_wall_stops_within_a_millimetre(spin: float) -> None:
    body = drive_for(make_body(0.7, left=spin, right=spin), 200, make_walls(1.0))
    nose = body.pose.x_m + HALF_LENGTH_M
    assert 1.0 - 1e-3 < nose <= 1.0


def test_base_at_an_oblique_wall_stops_with_its_corner() -> None:
    body = drive_for(make_body(0.0, 0.4), 400, make_walls(1.0))
    corner = HALF_LENGTH_M * math.cos(0.4) + 0.5 * BASE.dimensions_m[1] * math.sin(0.4)
    assert 1.0 - 1e-3 < body.pose.x_m + corner <= 1.0


def test_wheels_when_the_base_is_stopped_roll_on() -> None:
    body = drive_for(make_body(0.7), 50, make_walls(1.0))
    _, way = step_body(body, TICK_S, move=make_walls(1.0), random_source=STREAM)
    assert way.distance_m == pytest.approx(5.0 * 0.13 * TICK_S)


def test_base_when_stopped_can_back_off() -> None:
    stopped = drive_for(make_body(0.7), 50, make_walls(1.0))
    back = dataclasses.replace(stopped, spin=WheelSpin(-5.0, -5.0))
    assert drive_for(back, 10, make_walls(1.0)).pose.x_m == pytest.approx(
        stopped.pose.x_m - 10 * 5.0 * 0.13 * TICK_S, abs=1e-9
    )


def test_base_past_the_middle_of_a_wall_can_leave_ahead() -> None:
    body = make_body(1.2)
    assert drive_for(body, 100, make_walls(1.0)).pose.x_m == pytest.approx(1.2 + 1.3, abs=1e-9)


def test_base_in_contact_with_a_wall_leaves_backwards_but_not_through() -> None:
    walls = make_walls(1.0)
    start_m = 1.0 - HALF_LENGTH_M + 0.05
    ahead = drive_for(make_body(start_m), 200, walls)
    assert ahead.pose.x_m == pytest.approx(start_m, abs=1e-6)
    back = drive_for(make_body(start_m, left=-5.0, right=-5.0), 100, walls)
    assert back.pose.x_m == pytest.approx(start_m - 1.3, abs=1e-9)


def test_base_in_contact_with_one_wall_stops_at_the_next() -> None:
    # The rear is 0.2 m deep in the wall behind; that frees the base of no contact ahead.
    walls = make_walls(1.0, 1.6)
    start_m = 1.1 + HALF_LENGTH_M - 0.2
    body = drive_for(make_body(start_m), 200, walls)
    assert 1.6 - 1e-3 < body.pose.x_m + HALF_LENGTH_M <= 1.6


@pytest.mark.parametrize("yaw_rad", [0.0, 0.5 * math.pi, 0.3])
def test_base_in_contact_by_rounding_slides_turns_and_leaves(yaw_rad: float) -> None:
    walls = make_walls(1.0)
    reach_m = HALF_LENGTH_M * math.cos(yaw_rad) + 0.5 * BASE.dimensions_m[1] * math.sin(yaw_rad)
    x_m = 1.0 - reach_m + 1e-12
    back = drive_for(make_body(x_m, yaw_rad, left=-5.0, right=-5.0), 10, walls)
    moved_m = math.hypot(back.pose.x_m - x_m, back.pose.y_m)
    assert moved_m == pytest.approx(10 * 5.0 * 0.13 * TICK_S)
    ahead = drive_for(make_body(x_m, yaw_rad), 10, walls)
    assert ahead.pose.x_m <= x_m + 2e-6
    slides = yaw_rad == 0.5 * math.pi
    assert ahead.pose.y_m == pytest.approx(10 * 5.0 * 0.13 * TICK_S if slides else 0.0, abs=1e-3)


def test_base_when_turning_in_a_corridor_stops_at_the_wall() -> None:
    body = drive_for(
        make_body(1.0 - HALF_LENGTH_M - 0.001, left=1.0, right=-1.0), 300, make_walls(1.0)
    )
    yaw_rad = body.pose.yaw_rad
    reach_m = HALF_LENGTH_M * math.cos(yaw_rad) + 0.5 * BASE.dimensions_m[1] * math.sin(yaw_rad)
    assert body.pose.x_m + reach_m <= 1.0 + 1e-6
    assert 0.0 < yaw_rad < 0.1


def test_base_when_much_faster_than_itself_long_does_not_jump_over_a_wall() -> None:
    base = dataclasses.replace(BASE, max_speed_rad_s=1000.0)
    body = stand_still(base, ORIGIN, WheelSpin(1000.0, 1000.0))
    assert drive_for(body, 3, make_walls(1.0)).pose.x_m + HALF_LENGTH_M <= 1.0


def test_base_at_rest_uses_no_random_numbers() -> None:
    base = dataclasses.replace(BASE, slip_noise=0.1)
    body = drive_for(stand_still(base, ORIGIN, WheelSpin()), 10, make_walls(9.0))
    assert body.pose == PlanarPose(0.0, 0.0, 0.0)
    assert body.tick == 10


def test_slip_when_driven_twice_is_the_same_and_keyed_by_the_tick() -> None:
    base = dataclasses.replace(BASE, slip_noise=0.1)
    body = stand_still(base, ORIGIN, WheelSpin(2.0, 2.0))
    one, other = (drive_for(body, 20, make_walls(9.0)).pose for _ in range(2))
    later = drive_for(dataclasses.replace(body, tick=1), 20, make_walls(9.0)).pose
    assert one == other != later
