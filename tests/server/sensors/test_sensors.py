"""The table of sensors: every kind that a robot file can describe has one."""

from __future__ import annotations

from typing import get_args

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import GeometryItem, line_from_report
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import SensorDescription
from catoptra_server.sensors import Sensor, SensorContext, build_sensors
from helpers.robots import BASE, SENSORS

MOMENT = SensorContext(1.0, 0, Pose.identity())


def stream(name: str) -> RandomSource:
    return RandomSource.from_names(1, "R", name)


def build(*descriptions: SensorDescription) -> list[Sensor]:
    return build_sensors(descriptions, BASE, stream)


@pytest.mark.parametrize("description", SENSORS, ids=lambda d: d.name)
def test_sensor_when_built_answers_for_the_part_described(description: SensorDescription) -> None:
    (sensor,) = build(description)
    (part,) = sensor.parts
    assert (sensor.interval_s, part.type) == (description.interval_s, sensor.type)
    geometry = part.geometry()
    assert isinstance(geometry, GeometryItem)
    assert (part.name, geometry.name) == (description.name, description.name)
    assert geometry.location_m == description.mount.position_m
    line = line_from_report(part.configuration()).decode()
    assert f"{{Type {sensor.type}}} {{Name {description.name}}} {{" in line


@pytest.mark.parametrize("description", SENSORS, ids=lambda d: d.name)
def test_sensor_when_it_reads_says_its_type_and_name(description: SensorDescription) -> None:
    (sensor,) = build(description)
    line = line_from_report(sensor.read(MOMENT)).decode()
    assert f"{{Type {sensor.type}}} {{Name {description.name}" in line


def test_sensors_when_built_are_in_the_order_of_ut2004_s_cycle() -> None:
    types = [sensor.type for sensor in build(*reversed(SENSORS))]
    assert types == [
        "Sonar",
        "RangeScanner",
        "INS",
        "Odometry",
        "Encoder",
        "Tachometer",
        "Touch",
        "RFID",
        "VictSensor",
        "GroundTruth",
        "GPS",
    ]


def test_descriptions_when_listed_are_all_tested_here() -> None:
    assert set(get_args(SensorDescription)) == {type(description) for description in SENSORS}
