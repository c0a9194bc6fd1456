"""The tachometer: spin and turned angle of each wheel."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.robot.skid_steer import Rolled
from catoptra_server.sensors import Move
from catoptra_server.sensors.tachometer import TachometerSensor
from helpers.robots import BASE, TACHOMETER
from helpers.rooms import in_room


def tachometer(wheels: int = 4) -> TachometerSensor:
    description = dataclasses.replace(TACHOMETER, wheels=wheels)
    return TachometerSensor(description, BASE, RandomStream.of(1, "R", "Tach"))


def rolled(sensor: TachometerSensor, left_m: float, right_m: float) -> None:
    sensor.follow(Move(Rolled(left_m, right_m), 1, 0.02, PlanarPose(0.0, 0.0, 0.0)))


def test_wheels_when_rolling_are_told_right_and_left_in_turn() -> None:
    sensor = tachometer()
    rolled(sensor, 0.13 * 0.04, -0.13 * 0.01)
    reading = sensor.reading(in_room())
    assert reading.velocities_rad_s == pytest.approx((-0.5, 2.0, -0.5, 2.0))
    assert reading.positions_rad == pytest.approx((-0.01, 0.04, -0.01, 0.04))


def test_positions_when_rolling_on_add_up_while_velocities_do_not() -> None:
    sensor = tachometer(wheels=2)
    rolled(sensor, 0.13, 0.13)
    rolled(sensor, 0.0, 0.26)
    reading = sensor.reading(in_room())
    assert reading.velocities_rad_s == pytest.approx((100.0, 0.0))
    assert reading.positions_rad == pytest.approx((3.0, 1.0))


def test_reading_when_just_spawned_is_at_rest() -> None:
    reading = tachometer().reading(in_room())
    assert reading.velocities_rad_s == reading.positions_rad == (0.0,) * 4
