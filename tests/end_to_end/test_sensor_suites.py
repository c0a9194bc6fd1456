"""The bundled robots with all sensors in the rescue world, as USARSim's clients receive them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.readings import (
    GpsReading,
    RangeScanReading,
    Reading,
    RfidReading,
    SonarReadings,
    TouchReadings,
    VictimReading,
    reading_from_message,
)
from helpers.configs import ROBOTS, WORLDS
from helpers.control_lines import ControlLines, connect_control_lines
from helpers.server_process import start_server

SUITES = {"P2DX": "p2dx.ini", "OmniP2AT": "p2at_omni_full.ini", "P2AT": "p2at.ini"}
# In the first second the wheels travel about 0.3 m and the head turns; then a cycle is recorded.
IN_TRANSIT_TYPES = ("DRIVE {Left 2} {Right 2}", "MULTIDRIVE {CameraPan 0.1} {CameraTilt 0.1}")
# Sensor types of a P2DX in a capture of a real server.
P2DX_TYPES = {
    *("Sonar", "RangeScanner", "INS", "Odometry", "Encoder"),
    *("RFID", "VictSensor", "GroundTruth", "GPS"),
}


@pytest.fixture(scope="module", params=SUITES, ids=str)
def client(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[str, ControlLines, list[str]]]:
    """A robot's class, its connection, and the lines of one cycle in the yard."""
    class_ = str(request.param)
    folder = tmp_path_factory.mktemp("suite")
    robot, world = ROBOTS / SUITES[class_], WORLDS / "rescue.ini"
    with (
        start_server(folder, "--clock", "lockstep", robot=robot, world=world) as server,
        connect_control_lines(server.control_port) as lines,
    ):
        lines.send(f"INIT {{ClassName USARBot.{class_}}} {{Start Yard}}", *IN_TRANSIT_TYPES)
        lines.step(1.0)
        lines.send("DRIVE {Left 0} {Right 0}")
        yield class_, lines, lines.step(0.0)
        assert "no effect" not in server.log.read_text()


Client = tuple[str, ControlLines, list[str]]


def readings_by_type(lines: list[str]) -> dict[str, Reading]:
    """Readings of SEN lines by type."""
    found = {}
    for message in map(parse_message, lines):
        reading = reading_from_message(message) if message.word == "SEN" else None
        if reading is not None:
            found[message.get("Type") or ""] = reading
    return found


def test_cycle_has_every_sensor_of_the_capture(client: Client) -> None:
    _, _, lines = client
    assert set(readings_by_type(lines)) >= P2DX_TYPES
    assert [line.split(" ")[0] for line in lines[-2:]] == ["MISSTA", "STA"]


def test_ranges_are_those_of_the_yard(client: Client) -> None:
    class_, _, lines = client
    readings = readings_by_type(lines)
    scan, sonars = readings["RangeScanner"], readings["Sonar"]
    assert isinstance(scan, RangeScanReading)
    assert isinstance(sonars, SonarReadings)
    assert len(scan.ranges_m) == 181
    # The farthest corner of the building is 8 m away; the side walls are nearest.
    assert all(0.5 < range_m < 8.0 for range_m in scan.ranges_m)
    names = [name for name, _ in sonars.items]
    assert names == [f"{s}{n}" for s in ("F" if class_ == "P2DX" else "FR") for n in range(1, 9)]
    assert all(0.3 < range_m <= 5.0 for _, range_m in sonars.items)
    assert sum(range_m < 4.9 for _, range_m in sonars.items) >= 6


def test_tags_and_victims_are_those_of_the_world(client: Client) -> None:
    _, _, lines = client
    readings = readings_by_type(lines)
    rfid, victims = readings["RFID"], readings["VictSensor"]
    assert isinstance(rfid, RfidReading)
    assert isinstance(victims, VictimReading)
    assert set(rfid.ids) >= {1001, 1002, 1003}
    assert {part.name for part in victims.parts} == {"Chest", "Leg"}
    assert all(2.0 < math.dist((0, 0, 0), part.location_m) < 2.6 for part in victims.parts)
    touch = readings.get("Touch")
    assert touch is None or touch == TouchReadings((("Touch", False),))


def test_gps_when_under_the_open_sky_has_a_fix_near_the_origin(client: Client) -> None:
    _, _, lines = client
    gps = readings_by_type(lines)["GPS"]
    assert isinstance(gps, GpsReading)
    assert gps.has_fix
    assert gps.num_satellites >= 4
    # A ten-thousandth of a degree of latitude is 11 m.
    assert (gps.latitude_deg, gps.longitude_deg) == pytest.approx((39.1339, -77.2167), abs=1e-4)


def find_part_names(lines: list[str]) -> set[tuple[str, str]]:
    """Type and name of every part that the lines report."""
    found = set()
    for line in lines:
        type_ = re.search(r"\{Type (\w+)\}", line)
        kind = "MisPkg" if line.startswith("MISSTA") else type_[1] if type_ else ""
        if not line.startswith("STA"):
            found |= {(kind, name) for name in re.findall(r"\{Name (\w+)", line)}
    return found


UDK_ROBOT = """[Configuration]
BasedOn={}
[USARBot.P3AT]
+AddParts=(ItemClass=class'USARSensor.Touch',ItemName="T",Position=(X=0.25,Y=0,Z=0))
"""


def test_udk_dialect_has_the_time_of_odometry_encoders_and_touch(tmp_path: Path) -> None:
    robot = tmp_path / "p3at.ini"
    robot.write_text(UDK_ROBOT.format(ROBOTS / "p3at_udk.ini"), encoding="utf-8")
    world = WORLDS / "rescue.ini"
    arguments = ("--clock", "lockstep", "--dialect", "udk")
    with (
        start_server(tmp_path, *arguments, robot=robot, world=world) as server,
        connect_control_lines(server.control_port) as lines,
    ):
        lines.send("INIT {ClassName USARBot.P3AT} {Start Yard}", "DRIVE {Left 1} {Right 0.5}")
        lines.step(1.5)
        cycle = lines.step(0.0)
        assert next(line for line in cycle if "{Type INS}" in line).startswith("SEN {Type INS}")
        for type_, name in (("Odometry", "Odometer"), ("Encoder", "W1"), ("Touch", "T")):
            (line,) = [line for line in cycle if f"{{Type {type_}}}" in line]
            assert line.startswith(f"SEN {{Time 1.5000}} {{Type {type_}}} {{Name {name}}} ")
        (tachometer,) = [line for line in cycle if "{Type Tachometer}" in line]
        assert tachometer == (
            "SEN {Time 1.5000} {Type Tachometer} {Name TachTest} "
            "{Vel 0.5000,1.0000,0.5000,1.0000} {Pos 0.7500,1.5000,0.7500,1.5000}"
        )
        for type_, name in find_part_names(cycle):
            lines.send(f"GETCONF {{Type {type_}}} {{Name {name}}}")
            assert f"{{Name {name}}}" in lines.read_line()
            lines.send(f"GETGEO {{Type {type_}}} {{Name {name}}}")
            assert "{Mount P3AT}" in lines.read_line()
