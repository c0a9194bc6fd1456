"""The shipped robots with all their sensors in the rescue world, as USARSim's clients see them."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.readings import (
    EncoderReadings,
    GpsReading,
    GroundTruthReading,
    InsReading,
    OdometryReading,
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
# Wheels roll about 0.3 m in a second; the head turns; then a whole cycle is told.
IN_TRANSIT_TYPES = ("DRIVE {Left 2} {Right 2}", "MULTIDRIVE {CameraPan 0.1} {CameraTilt 0.1}")
# What a P2DX told on a real wire.
P2DX_TYPES = {
    *("Sonar", "RangeScanner", "INS", "Odometry", "Encoder"),
    *("RFID", "VictSensor", "GroundTruth", "GPS"),
}


@pytest.fixture(scope="module", params=SUITES, ids=str)
def client(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[str, ControlLines, list[str]]]:
    """Yield a robot's class, its connection, and a whole cycle of lines from the yard."""
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


def count_readings(lines: list[str]) -> dict[str, Reading]:
    """Return the readings of SEN lines by their type."""
    found = {}
    for message in map(parse_message, lines):
        reading = reading_from_message(message) if message.word == "SEN" else None
        if reading is not None:
            found[message.get("Type") or ""] = reading
    return found


def test_cycle_when_told_has_every_sensor_seen_on_the_wire(client: Client) -> None:
    _, _, lines = client
    assert set(count_readings(lines)) >= P2DX_TYPES
    assert [line.split(" ")[0] for line in lines[-2:]] == ["MISSTA", "STA"]


def test_ranges_when_told_are_of_the_yard(client: Client) -> None:
    class_, _, lines = client
    told = count_readings(lines)
    scan, sonars = told["RangeScanner"], told["Sonar"]
    assert isinstance(scan, RangeScanReading)
    assert isinstance(sonars, SonarReadings)
    assert len(scan.ranges_m) == 181
    # The farthest corner of the building is 8 m away; nothing is nearer than the walls aside.
    assert all(0.5 < range_m < 8.0 for range_m in scan.ranges_m)
    names = [name for name, _ in sonars.items]
    assert names == [f"{s}{n}" for s in ("F" if class_ == "P2DX" else "FR") for n in range(1, 9)]
    assert all(0.3 < range_m <= 5.0 for _, range_m in sonars.items)
    assert sum(range_m < 4.9 for _, range_m in sonars.items) >= 6


def test_poses_when_told_agree(client: Client) -> None:
    _, _, lines = client
    told = count_readings(lines)
    truth, ins, odometry = told["GroundTruth"], told["INS"], told["Odometry"]
    assert isinstance(truth, GroundTruthReading)
    assert isinstance(ins, InsReading)
    assert isinstance(odometry, OdometryReading)
    rolled_m = truth.location_m[0] + 2.2  # the start pose Yard
    assert 0.15 < rolled_m < 0.3
    # Two decimals, and some millimetres of noise after a quarter of a metre.
    assert ins.location_m[:2] == pytest.approx(truth.location_m[:2], abs=0.03)
    assert odometry.x_m == pytest.approx(rolled_m, abs=0.03)


def test_counts_when_told_are_of_wheels_and_of_the_head(client: Client) -> None:
    _, _, lines = client
    encoders = count_readings(lines)["Encoder"]
    assert isinstance(encoders, EncoderReadings)
    ticks = dict(encoders.items)
    # 2 rad and 0.1 rad in ticks of 0.01745 rad, give or take one by the noise of 0.005 rad.
    assert [ticks["ECLeft"], ticks["ECRight"]] == pytest.approx([114, 114], abs=1.5)
    assert [ticks["ECPan"], ticks["ECTilt"]] == pytest.approx([5, 5], abs=1.5)


def test_finds_when_told_are_what_the_world_holds(client: Client) -> None:
    _, _, lines = client
    told = count_readings(lines)
    rfid, victims = told["RFID"], told["VictSensor"]
    assert isinstance(rfid, RfidReading)
    assert isinstance(victims, VictimReading)
    assert set(rfid.ids) >= {1001, 1002, 1003}
    assert {part.name for part in victims.parts} == {"Chest", "Leg"}
    assert all(2.0 < math.dist((0, 0, 0), part.location_m) < 2.6 for part in victims.parts)
    touch = told.get("Touch")
    assert touch is None or touch == TouchReadings((("Touch", False),))


def test_gps_when_under_the_open_sky_has_a_fix_near_the_origin(client: Client) -> None:
    _, _, lines = client
    gps = count_readings(lines)["GPS"]
    assert isinstance(gps, GpsReading)
    assert gps.has_fix
    assert gps.num_satellites >= 4
    # A ten-thousandth of a degree of latitude is 11 m.
    assert (gps.latitude_deg, gps.longitude_deg) == pytest.approx((39.1339, -77.2167), abs=1e-4)


def named_parts(lines: list[str]) -> set[tuple[str, str]]:
    """Return type and name of all that tells of itself."""
    found = set()
    for line in lines:
        type_ = re.search(r"\{Type (\w+)\}", line)
        kind = "MisPkg" if line.startswith("MISSTA") else type_[1] if type_ else ""
        if not line.startswith("STA"):
            found |= {(kind, name) for name in re.findall(r"\{Name (\w+)", line)}
    return found


def test_questions_when_asked_as_the_nist_client_does_are_all_answered(client: Client) -> None:
    class_, lines, told = client
    asked = named_parts(told) | {("Camera", "Camera")}
    assert len(asked) >= 19
    for type_, name in sorted(asked):
        lines.send(f"GETCONF {{Type {type_}}} {{Name {name}}}")
        conf = lines.read_line()
        assert conf.startswith(f"CONF {{Type {type_}}} {{Name {name}}} {{"), conf
        lines.send(f"GETGEO {{Type {type_}}} {{Name {name}}}")
        geo = lines.read_line()
        assert geo.startswith(f"GEO {{Type {type_}}} {{Name {name}"), geo
        assert all(key in geo for key in ("Location ", "Orientation ")), geo
    lines.send("GETCONF {Type Robot} {Name R1}", "GETGEO {Type Robot} {Name R1}")
    assert lines.read_line().startswith(
        f"CONF {{Type GroundVehicle}} {{Name {class_}}} {{SteeringType"
    )
    assert lines.read_line().startswith(
        f"GEO {{Type GroundVehicle}} {{Name {class_}}} {{Dimensions"
    )


def test_questions_when_asked_for_whole_types_fit_into_a_clients_buffer(client: Client) -> None:
    _, lines, told = client
    for type_ in sorted({type_ for type_, _ in named_parts(told)} | {"Camera"}):
        lines.send(f"GETGEO {{Type {type_}}}", f"GETCONF {{Type {type_}}}", "STEP {Time 0}")
        answers = [line for line in lines.read_until("RES") if line.startswith(("GEO", "CONF"))]
        assert len(answers) >= 2


UDK_ROBOT = """[Configuration]
BasedOn={}
[USARBot.P3AT]
+AddParts=(ItemClass=class'USARSensor.Touch',ItemName="T",Position=(X=0.25,Y=0,Z=0))
"""


def test_udk_when_spoken_tells_the_time_of_odometry_encoders_and_touch(tmp_path: Path) -> None:
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
        told = lines.step(0.0)
        assert next(line for line in told if "{Type INS}" in line).startswith("SEN {Type INS}")
        for type_, name in (("Odometry", "Odometer"), ("Encoder", "W1"), ("Touch", "T")):
            (line,) = [line for line in told if f"{{Type {type_}}}" in line]
            assert line.startswith(f"SEN {{Time 1.5000}} {{Type {type_}}} {{Name {name}}} ")
        (tachometer,) = [line for line in told if "{Type Tachometer}" in line]
        assert tachometer == (
            "SEN {Time 1.5000} {Type Tachometer} {Name TachTest} "
            "{Vel 0.5000,1.0000,0.5000,1.0000} {Pos 0.7500,1.5000,0.7500,1.5000}"
        )
        for type_, name in named_parts(told):
            lines.send(f"GETCONF {{Type {type_}}} {{Name {name}}}")
            assert f"{{Name {name}}}" in lines.read_line()
            lines.send(f"GETGEO {{Type {type_}}} {{Name {name}}}")
            assert "{Mount HARD}" in lines.read_line()
