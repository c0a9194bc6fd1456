"""The table of sensors: every kind that a robot file can describe has one."""

from __future__ import annotations

from typing import get_args

import pytest

from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import SensorDescription
from catoptra_server.sensors import build_sensor
from helpers.robots import BASE, ODOMETRY, TRUTH


@pytest.mark.parametrize("description", [ODOMETRY, TRUTH])
def test_sensor_when_built_has_the_name_and_period_described(
    description: SensorDescription,
) -> None:
    sensor = build_sensor(description, BASE, RandomStream.of(1, "x"))
    assert (sensor.name, sensor.interval_s) == (description.name, description.interval_s)


def test_descriptions_when_listed_are_all_tested_here() -> None:
    assert set(get_args(SensorDescription)) == {type(ODOMETRY), type(TRUTH)}
