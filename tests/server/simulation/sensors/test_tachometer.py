"""The tachometer: spin and angle of each wheel."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors import MotionStep
from catoptra_server.simulation.sensors.tachometer import TachometerSensor
from helpers.robots import BASE, TACHOMETER
from helpers.room_ray_caster import context_in_room


def make_tachometer(wheels: int = 4) -> TachometerSensor:
    description = dataclasses.replace(TACHOMETER, num_wheels=wheels)
    return TachometerSensor(description, BASE, RandomSource.from_names(1, "R", "Tach"))


def roll(sensor: TachometerSensor, left_m: float, right_m: float) -> None:
    sensor.update(MotionStep(WheelTravel(left_m, right_m), 1, 0.02, PlanarPose(0.0, 0.0, 0.0)))


def test_wheels_when_rolling_are_reported_right_and_left_alternating() -> None:
    sensor = make_tachometer()
    roll(sensor, 0.13 * 0.04, -0.13 * 0.01)
    reading = sensor.read(context_in_room())
    assert reading.velocities_rad_s == pytest.approx((-0.5, 2.0, -0.5, 2.0))
    assert reading.positions_rad == pytest.approx((-0.01, 0.04, -0.01, 0.04))


def test_positions_when_rolling_on_add_up_while_velocities_do_not() -> None:
    sensor = make_tachometer(wheels=2)
    roll(sensor, 0.13, 0.13)
    roll(sensor, 0.0, 0.26)
    reading = sensor.read(context_in_room())
    assert reading.velocities_rad_s == pytest.approx((100.0, 0.0))
    assert reading.positions_rad == pytest.approx((3.0, 1.0))


def test_reading_when_just_spawned_is_at_rest() -> None:
    reading = make_tachometer().read(context_in_room())
    assert reading.velocities_rad_s == reading.positions_rad == (0.0,) * 4
