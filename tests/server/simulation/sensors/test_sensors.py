"""The table of sensors: each kind is read, built and reported, in UT2004's order."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import GeometryItem, Report, line_from_report
from catoptra_server.config.robot_file import read_robot
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount, SensorDescription
from catoptra_server.simulation.sensors import (
    SENSOR_KINDS,
    MotionStep,
    Sensor,
    SensorContext,
    SensorKind,
    build_sensors,
    casts_rays,
)
from catoptra_server.simulation.sensors.odometry import ODOMETRY
from helpers.robots import BASE

CONTEXT = SensorContext(1.0, 0, Pose.identity())
# Several classes of robot files share a kind.
KINDS = [*dict.fromkeys(SENSOR_KINDS.values())]
CLASSES = [(kind, class_name) for kind in KINDS for class_name in kind.readers]


def read_default(folder: Path, class_name: str) -> SensorDescription:
    """Description of a sensor without a section: all values are defaults."""
    path = folder / "robot.ini"
    item = f"Sensors=(ItemClass=class'USARBot.{class_name}',ItemName=\"S\",Position=(X=0.1))"
    path.write_text(f"[USARBot.P2AT]\n{item}\n", encoding="utf-8")
    (description,) = read_robot(path)[0].sensors
    return description


def build(*descriptions: SensorDescription) -> list[Sensor]:
    return build_sensors(descriptions, BASE, lambda name: RandomSource.from_names(1, "R", name))


@pytest.mark.parametrize(("kind", "class_name"), CLASSES, ids=[name for _, name in CLASSES])
def test_class_when_read_has_the_description_of_its_kind(
    tmp_path: Path, kind: SensorKind, class_name: str
) -> None:
    assert type(read_default(tmp_path, class_name)) is kind.description


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.description.__name__)
def test_sensor_when_built_replies_for_the_part_described(tmp_path: Path, kind: SensorKind) -> None:
    description = read_default(tmp_path, next(iter(kind.readers)))
    (sensor,) = build(description)
    (part,) = sensor.parts
    assert (sensor.interval_s, part.type) == (description.interval_s, sensor.type)
    geometry = part.geometry()
    assert isinstance(geometry, GeometryItem)
    assert (part.name, geometry.name) == (description.name, description.name)
    assert geometry.location_m == description.mount.position_m == (0.1, 0.0, 0.0)
    line = line_from_report(part.configuration()).decode()
    assert f"{{Type {sensor.type}}} {{Name S}} {{" in line


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.description.__name__)
def test_reading_when_reported_has_type_and_name(tmp_path: Path, kind: SensorKind) -> None:
    (sensor,) = build(read_default(tmp_path, next(iter(kind.readers))))
    line = line_from_report(sensor.instrument.read(CONTEXT)).decode()
    assert f"{{Type {sensor.type}}} {{Name S" in line


def test_sensors_when_built_are_in_the_order_of_ut2004_s_cycle(tmp_path: Path) -> None:
    descriptions = [read_default(tmp_path, next(iter(kind.readers))) for kind in KINDS]
    types = [sensor.type for sensor in build(*reversed(descriptions))]
    cycle = "Sonar RangeScanner INS Odometry Encoder Tachometer Touch RFID VictSensor".split()
    assert [type_ for type_ in types if type_ in cycle] == cycle


def test_class_names_when_listed_are_of_one_kind_each_and_in_lower_case() -> None:
    names = [name for _, name in CLASSES]
    assert len(set(names)) == len(names)
    assert names == [name.lower() for name in names]


def test_streams_when_shared_have_names_that_no_sensor_has() -> None:
    shared = [kind.shared_stream for kind in KINDS if kind.shared_stream is not None]
    assert len(set(shared)) == len(shared)
    assert all(" " in name for name in shared)


@dataclass(frozen=True)
class _DummyDescription:
    name: str
    interval_s: float
    mount: Mount


class _DummySensor:
    def __init__(
        self, description: _DummyDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        pass

    def update(self, motion: MotionStep) -> None:
        pass

    def read(self, context: SensorContext) -> Report:
        raise NotImplementedError


def test_dummy_kind_when_added_to_the_table_is_read_and_built() -> None:
    dummy = SensorKind("Dummy", _DummyDescription, _DummySensor, {"dummy": lambda item: _DUMMY})
    sensors = build_sensors([_DUMMY], BASE, lambda name: RandomSource.from_names(1, name), (dummy,))
    assert [sensor.type for sensor in sensors] == ["Dummy"]
    assert build(_DUMMY) == []


_DUMMY = _DummyDescription("D", 0.2, Mount())


def test_rays_when_cast_are_known_by_the_kind(tmp_path: Path) -> None:
    assert casts_rays(read_default(tmp_path, "Sonar"))
    assert not casts_rays(read_default(tmp_path, "Odometry"))
    assert not ODOMETRY.casts_rays
