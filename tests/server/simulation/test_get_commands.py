"""GETCONF and GETGEO of every bundled robot: no or an empty reply stalls real clients."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.commands import GetConf, GetGeo
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.config.robot_file import read_robots
from catoptra_server.simulation.commands import execute_get_conf, execute_get_geo
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from helpers.configs import ROBOTS
from helpers.robots import FakeViewProvider, make_p2at


def spawn(description: RobotDescription) -> Robot:
    pose = PlanarPose(0.0, 0.0, 0.0)
    return Robot(description, pose, name="R", seed=1, time_s=0.0)


@cache
def bundled_robots() -> tuple[tuple[str, RobotDescription], ...]:
    files = sorted(ROBOTS.glob("*.ini"))
    return tuple((path.name, robot) for path in files for robot in read_robots(Path(path))[0])


PARTS = [
    pytest.param(robot, part.type, part.name, id=f"{file}-{robot.model_name}-{part.name}")
    for file, robot in bundled_robots()
    for sensor in spawn(robot).sensors
    for part in sensor.parts
]


@pytest.mark.parametrize(("description", "type_", "name"), PARTS)
def test_sensor_of_a_bundled_robot_replies_with_its_name(
    description: RobotDescription, type_: str, name: str
) -> None:
    robot = spawn(description)
    (conf,) = execute_get_conf(robot, GetConf(type_.upper(), name.lower()))
    line = line_from_report(conf).decode()
    assert line.startswith(f"CONF {{Type {type_}}} {{Name {name}}} {{")
    (geo,) = execute_get_geo(robot, GetGeo(type_, name))
    line = line_from_report(geo).decode()
    assert f"{{Name {name} Location " in line
    assert " Mount HARD}" in line


@pytest.mark.parametrize(
    "description",
    [robot for _, robot in bundled_robots()],
    ids=[name for name, _ in bundled_robots()],
)
def test_line_of_a_bundled_robot_names_parts_that_reply(
    description: RobotDescription,
) -> None:
    robot = spawn(description)
    for sensor, report in zip(robot.sensors, robot.read_all(0.0), strict=False):
        line = line_from_report(report).decode()
        assert all(f"{{Name {part.name}" in line for part in sensor.parts)


def test_sonars_when_requested_together_have_one_geo_and_a_conf_each() -> None:
    robot = spawn(next(robot for file, robot in bundled_robots() if file == "p2at.ini"))
    assert len(execute_get_conf(robot, GetConf("Sonar"))) == 16
    (geo,) = execute_get_geo(robot, GetGeo("Sonar"))
    assert (
        b"{Name F2 Location 0.1850,-0.1150,0.0000 Orientation 0.0000,0.0000,-0.8727 Mount HARD} "
        b"{Name F3 "
    ) in line_from_report(geo)


def test_package_and_camera_when_requested_reply() -> None:
    robot = spawn(next(robot for file, robot in bundled_robots() if file == "p2at.ini"))
    (geo,) = execute_get_geo(robot, GetGeo("MisPkg"))
    assert line_from_report(geo).startswith(b"GEO {Type MisPkg} {Name CameraPanTilt} {Link 1} ")
    (geo,) = execute_get_geo(robot, GetGeo("Camera", "Camera"))
    assert line_from_report(geo) == (
        b"GEO {Type Camera} {Name Camera Location 0.0820,0.0002,0.0613 "
        b"Orientation 0.0000,0.0000,0.0000 Mount CameraTilt}\r\n"
    )


def test_question_when_nothing_matches_has_the_empty_form() -> None:
    robot = spawn(make_p2at())
    (conf,) = execute_get_conf(robot, GetConf("RFID"))
    (geo,) = execute_get_geo(robot, GetGeo("RFID", "X"))
    assert line_from_report(conf) == b"CONF {Type RFID}\r\n"
    assert line_from_report(geo) == b"GEO {Type RFID} {Name X}\r\n"


def test_omni_camera_when_its_bound_is_known_reports_it_after_the_camera_model() -> None:
    robot = spawn(make_p2at())
    (in_short,) = execute_get_conf(robot, GetConf("Camera", "OmniCam"))
    (whole,) = execute_get_conf(robot, GetConf("Camera", "OmniCam"), FakeViewProvider().error_bound)
    line, longer = (line_from_report(conf).decode().strip() for conf in (in_short, whole))
    assert longer.startswith(line)
    assert longer.removeprefix(line).startswith(" {ErrorBoundPx 0.3535")
    assert "{ErrorRmsPx 0.0000" in longer


# Lines of a capture of UDK, for the robot whose configuration `p3at_udk.ini` holds.
UDK_CAPTURE = [
    (
        GetGeo("RangeScanner"),
        b"GEO {Type RangeScanner} {Name lms200} {Location 0.21,0.00,-0.20} "
        b"{Orientation 0.00,0.00,0.00}{Mount P3AT}\r\n",
    ),
    (GetConf("INS"), b"CONF {Type INS} {Name InsTest} {ScanInterval 0.2000}\r\n"),
    (GetConf("GroundTruth"), b"CONF {Type GroundTruth} {Name GndTruth} {ScanInterval 0.1000}\r\n"),
]


@pytest.mark.parametrize(("command", "line"), UDK_CAPTURE)
def test_reply_in_udk_equals_the_capture(command: GetConf | GetGeo, line: bytes) -> None:
    (description,) = (robot for file, robot in bundled_robots() if file == "p3at_udk.ini")
    execute = execute_get_geo if isinstance(command, GetGeo) else execute_get_conf
    (report,) = execute(spawn(description), command)  # type: ignore[operator] # chosen by its type
    assert line_from_report(report, Dialect.UDK) == line
