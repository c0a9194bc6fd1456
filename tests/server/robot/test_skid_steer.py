"""Wheel spin to travel to pose: directions, limits, slip, and the hard cases of the arc."""

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
    WheelSpin,
    WheelTravel,
    apply_slip,
    integrate_arc,
    wheel_travel,
)
from catoptra_server.simulation.robot_description import PlanarPose
from helpers.robots import BASE

ORIGIN = PlanarPose(0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [(10.0, -10.0, (5.0, -5.0)), (1.0, 2.0, (1.0, 2.0)), (math.inf, -math.inf, (5.0, -5.0))],
)
def test_spin_when_limited_saturates_each_side(
    left: float, right: float, expected: tuple[float, float]
) -> None:
    assert WheelSpin(left, right).clamp(5.0) == WheelSpin(*expected)


def test_travel_with_equal_spins_is_straight() -> None:
    way = wheel_travel(BASE, WheelSpin(2.0, 2.0), 2.0)
    assert way.distance_m == pytest.approx(0.52, abs=1e-15)
    assert way.turn_rad(BASE) == 0.0


def test_turn_when_left_is_faster_is_clockwise() -> None:
    assert wheel_travel(BASE, WheelSpin(1.0, -1.0), 1.0).turn_rad(BASE) == pytest.approx(
        0.26 / 0.4712
    )


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


def test_slip_when_there_is_none_changes_nothing() -> None:
    way = WheelTravel(0.3, -0.1)
    assert apply_slip(BASE, way, np.random.default_rng(1)) == way


def test_slip_when_turning_loses_its_fraction_and_no_distance() -> None:
    base = dataclasses.replace(BASE, turn_slip=0.1)
    way = WheelTravel(0.3, -0.1)
    real = apply_slip(base, way, np.random.default_rng(1))
    assert real.turn_rad(base) == pytest.approx(0.9 * way.turn_rad(base), rel=1e-14)
    assert real.distance_m == pytest.approx(way.distance_m, rel=1e-14)


@pytest.mark.parametrize("ticks", [10, 250])
def test_slip_noise_when_cut_into_ticks_has_the_same_spread(ticks: int) -> None:
    base = dataclasses.replace(BASE, slip_noise=0.02)
    stream = RandomSource.from_names(1, "test")
    ends = []
    for run in range(400):
        ways = [
            apply_slip(
                base, WheelTravel(1.0 / ticks, 1.0 / ticks), stream.generator(run * ticks + tick)
            )
            for tick in range(ticks)
        ]
        ends.append(sum(way.left_m for way in ways))
    # 2 cm after 1 m; the spread of 400 runs is known to 3.5 % (one sigma), the mean to 1 mm.
    assert np.std(ends) == pytest.approx(0.02, rel=0.12)
    assert np.mean(ends) == pytest.approx(1.0, abs=0.004)
