"""The tachometer: spin and angle of each wheel."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors import MotionStep
from helpers.robots import TACHOMETER, make_instrument
from helpers.room_ray_caster import context_in_room


def roll(sensor: Any, left_m: float, right_m: float) -> None:
    sensor.update(MotionStep(WheelTravel(left_m, right_m), 1, 0.02, PlanarPose(0.0, 0.0, 0.0)))


def test_wheels_when_rolling_are_reported_right_and_left_alternating() -> None:
    sensor = make_instrument(TACHOMETER)
    roll(sensor, 0.13 * 0.04, -0.13 * 0.01)
    reading = sensor.read(context_in_room())
    assert reading.velocities_rad_s == pytest.approx((-0.5, 2.0, -0.5, 2.0))
    assert reading.positions_rad == pytest.approx((-0.01, 0.04, -0.01, 0.04))


def test_positions_when_rolling_on_add_up_while_velocities_do_not() -> None:
    sensor = make_instrument(dataclasses.replace(TACHOMETER, num_wheels=2))
    roll(sensor, 0.13, 0.13)
    roll(sensor, 0.0, 0.26)
    reading = sensor.read(context_in_room())
    assert reading.velocities_rad_s == pytest.approx((100.0, 0.0))
    assert reading.positions_rad == pytest.approx((3.0, 1.0))


def test_reading_when_just_spawned_is_at_rest() -> None:
    reading = make_instrument(TACHOMETER).read(context_in_room())
    assert reading.velocities_rad_s == reading.positions_rad == (0.0,) * 4
