"""SET, GETCONF and GETGEO, commands that need power, and driving the robots of others."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from catoptra_protocol.usarsim.commands import (
    Drive,
    GetConf,
    GetGeo,
    Init,
    SetCommand,
    ShareControl,
    Trace,
)
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.reports import (
    EncoderReadings,
    InsReading,
    OdometryReading,
    line_from_report,
)
from catoptra_server.config.robot_file import read_robots
from catoptra_server.render.renderer import AccuracyTarget
from catoptra_server.simulation.commands import execute_control, execute_get_conf, execute_get_geo
from catoptra_server.simulation.events import RejectedError
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import (
    Mount,
    PerspectiveCameraDescription,
    PlanarPose,
    RobotDescription,
)
from catoptra_server.simulation.sensors import EMPTY_ENVIRONMENT, SensorEnvironment
from catoptra_server.world.scene_mesh import build_scene
from helpers.configs import ROBOTS
from helpers.robots import (
    ENCODER,
    INS,
    ODOMETRY,
    SCANNER,
    FakeClient,
    FakeViewProvider,
    make_ground,
    make_p2at,
    make_robot_at,
    make_walled_world,
)

CAMERA = PerspectiveCameraDescription("Camera", Mount(), 320, 240, 1.3963, 0.3491, 2.0944)


def drive_robot() -> Robot:
    """Robot that has moved 0.26 m."""
    description = make_p2at(
        sensors=(SCANNER, INS, ODOMETRY, ENCODER), perspective_cameras=(CAMERA,)
    )
    robot = make_robot_at(description, PlanarPose(0.0, 0.0, 0.0), name="R", seed=1, time_s=0.0)
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    for tick in range(1, 51):
        robot.step(0.02, 0.02 * tick, make_ground().move)
    return robot


def execute(robot: Robot, command: SetCommand) -> str:
    reports = execute_control(robot, command, 1.0, lambda: EMPTY_ENVIRONMENT)
    return b"".join(map(line_from_report, reports)).decode().replace("1.0000", "1.00")


def read(robot: Robot, kind: type) -> object:
    return next(r for r in robot.read_all(1.0) if isinstance(r, kind))


def test_odometry_when_reset_is_zero() -> None:
    robot = drive_robot()
    answer = execute(robot, SetCommand("Odometry", "odometry", "RESET"))
    assert answer == "RES {Time 1.00} {Type Odometry} {Name odometry} {Status OK}\r\n"
    assert read(robot, OdometryReading) == OdometryReading("Odometry", 0, 0, 0, time_s=1.0)


def test_encoder_when_reset_is_zero() -> None:
    robot = drive_robot()
    assert read(robot, EncoderReadings) == EncoderReadings((("ECLeft", 114),), 1.0)
    assert "{Status OK}" in execute(robot, SetCommand("Encoder", None, "Reset"))
    assert read(robot, EncoderReadings) == EncoderReadings((("ECLeft", 0),), 1.0)


def test_ins_when_set_to_a_pose_reports_the_pose() -> None:
    robot = drive_robot()
    assert "{Status OK}" in execute(robot, SetCommand("INS", "INS", "POSE", "1,2,0,0,0,0.5"))
    ins = read(robot, InsReading)
    assert isinstance(ins, InsReading)
    assert ins.location_m[:2] == pytest.approx((1.0, 2.0))


def test_camera_when_zoomed_confirms_the_field_of_view() -> None:
    robot = drive_robot()
    answer = execute(robot, SetCommand("Camera", "Camera", fov_rad=0.7853))
    assert answer == ("RES {Time 1.00} {Type Camera} {Name Camera} {FOV 0.7853} {Status OK}\r\n")
    assert "{FOV 1.3963}" in execute(robot, SetCommand("camera", None, "ZOOM", "0"))


def test_scan_when_requested_precedes_its_result() -> None:
    answer = execute(drive_robot(), SetCommand("RangeScanner", "Scanner1", "SCAN"))
    assert [line.split()[0] for line in answer.splitlines()] == ["SEN", "RES"]


@pytest.mark.parametrize(
    "command",
    [
        SetCommand("Toaster", "T", "ON"),
        SetCommand("Odometry", "Odometry", "EXPLODE"),
        SetCommand("Odometry", "Other", "RESET"),
        SetCommand("Encoder", "Other", "RESET"),
        SetCommand("INS", "INS", "POSE", "1,2,3"),
        SetCommand("Camera", "Other", fov_rad=1.0),
        SetCommand("Camera", "Camera"),
        SetCommand("RangeScanner", "Other", "SCAN"),
        SetCommand(""),
    ],
)
def test_command_when_impossible_has_the_result_failed(command: SetCommand) -> None:
    answer = execute(drive_robot(), command)
    assert answer.startswith("RES {Time 1.00}")
    assert answer.endswith("{Status Failed}\r\n")


def accuracy_target(robot: Robot) -> AccuracyTarget:
    return robot.omni_cameras[0].camera_spec().render_settings.accuracy_target


def test_omni_camera_when_set_to_a_target_is_rendered_by_the_target() -> None:
    robot = drive_robot()
    answer = execute(robot, SetCommand("Camera", "OmniCam", "MaxError", "0.5"))
    assert answer == "RES {Time 1.00} {Type Camera} {Name OmniCam} {Status OK}\r\n"
    assert "{Status OK}" in execute(robot, SetCommand("camera", None, "BUDGET", "20"))
    assert accuracy_target(robot) == AccuracyTarget(0.5, 20.0)
    assert "{Status OK}" in execute(robot, SetCommand("Camera", "omnicam", "MaxError", "0"))
    assert accuracy_target(robot) == AccuracyTarget(0.0, 20.0)


@pytest.mark.parametrize(
    ("name", "params"), [("OmniCam", "-1"), ("OmniCam", "1,2"), ("OmniCam", None), ("Camera", "1")]
)
def test_accuracy_target_when_invalid_has_the_result_failed_and_stays(
    name: str, params: str | None
) -> None:
    robot = drive_robot()
    assert "{Status Failed}" in execute(robot, SetCommand("Camera", name, "MaxError", params))
    assert accuracy_target(robot) == AccuracyTarget()


def spawn(description: RobotDescription) -> Robot:
    pose = PlanarPose(0.0, 0.0, 0.0)
    return make_robot_at(description, pose, name="R", seed=1, time_s=0.0)


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
def test_line_of_a_bundled_robot_names_parts_that_reply(description: RobotDescription) -> None:
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


def refuse_to_sense() -> SensorEnvironment:
    raise AssertionError("the command reads no sensor")


def test_trace_is_accepted_without_a_reply() -> None:
    command = Trace(True, 1.0, "Red")
    assert execute_control(spawn(make_p2at()), command, 0.0, refuse_to_sense) == []


ROLLING = (1.0, -1.0)


class SharingFleet:
    """Fleet of an owner's robot, and another client without one."""

    def __init__(self, *, shared: bool = True) -> None:
        world = make_walled_world()
        self.fleet = Fleet([make_p2at()], world, build_scene(world), seed=1)
        self.owner, self.driver = FakeClient(), FakeClient()
        init = Init("USARBot.OmniP2AT", name="R", location_m=(0.0, 0.0, 0.0))
        self.fleet.execute(self.owner, init, 0.0)
        if shared:
            self.fleet.execute(self.owner, ShareControl(True), 0.0)

    def drive(
        self, client: FakeClient, left: float | None = 1.0, right: float | None = -1.0
    ) -> None:
        """Drive the robot by its name."""
        self.fleet.remote_control.drive(client, "R", Drive(left, right), 0.0)

    @property
    def speeds(self) -> tuple[float, float]:
        """Commanded wheel speeds of the robot."""
        robot = self.fleet.find_robot(self.owner)
        assert robot is not None
        return robot.wheel_speeds_rad_s


def test_robot_when_not_shared_is_driven_by_its_owner_only() -> None:
    sharing = SharingFleet(shared=False)
    with pytest.raises(RejectedError, match="does not share its control"):
        sharing.drive(sharing.driver)
    assert sharing.speeds == (0.0, 0.0)
    sharing.drive(sharing.owner)
    assert sharing.speeds == ROLLING


@pytest.mark.parametrize("name", ["", "r", "R2", "R\n"])
def test_robot_when_unknown_is_not_driven(name: str) -> None:
    sharing = SharingFleet()
    with pytest.raises(RejectedError, match=re.escape(f"there is no robot {name!r}")):
        sharing.fleet.remote_control.drive(sharing.driver, name, Drive(1.0, 1.0), 0.0)
    assert sharing.speeds == (0.0, 0.0)


def test_robot_when_its_owner_has_left_is_unknown() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.fleet.remove(sharing.owner)
    with pytest.raises(RejectedError, match="no robot 'R'"):
        sharing.drive(sharing.driver)
    # Nothing is left to halt.
    sharing.fleet.remote_control.halt_robots_driven_by(sharing.driver, 0.0)


def test_robot_when_no_longer_shared_halts() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.fleet.execute(sharing.owner, ShareControl(False), 0.0)
    assert sharing.speeds == (0.0, 0.0)
    with pytest.raises(RejectedError, match="does not share"):
        sharing.drive(sharing.driver)


def test_robot_when_driven_by_its_owner_rolls_on_as_the_sharing_ends() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.fleet.execute(sharing.owner, Drive(2.0, 2.0), 0.0)
    sharing.fleet.execute(sharing.owner, ShareControl(False), 0.0)
    assert sharing.speeds == (2.0, 2.0)


def test_robot_when_its_driver_disconnects_halts() -> None:
    sharing, other = SharingFleet(), FakeClient()
    sharing.drive(sharing.driver)
    sharing.fleet.remote_control.halt_robots_driven_by(other, 0.0)
    assert sharing.speeds == ROLLING
    sharing.fleet.remote_control.halt_robots_driven_by(sharing.driver, 0.0)
    assert sharing.speeds == (0.0, 0.0)


def test_robot_when_another_has_taken_over_rolls_on_as_its_former_driver_disconnects() -> None:
    sharing, other = SharingFleet(), FakeClient()
    sharing.drive(sharing.driver)
    sharing.drive(other, 0.5, 0.5)
    sharing.fleet.remote_control.halt_robots_driven_by(sharing.driver, 0.0)
    assert sharing.speeds == (0.5, 0.5)


def test_robot_when_halted_by_its_driver_is_no_longer_driven() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver)
    sharing.drive(sharing.driver, 0.0, 0.0)
    sharing.fleet.execute(sharing.owner, Drive(2.0, 2.0), 0.0)
    sharing.fleet.remote_control.halt_robots_driven_by(sharing.driver, 0.0)
    assert sharing.speeds == (2.0, 2.0)


def test_speeds_of_others_are_limited_as_those_of_the_owner() -> None:
    sharing = SharingFleet()
    sharing.drive(sharing.driver, 1e300, -1e300)
    assert sharing.speeds == (5.385, -5.385)


def test_sharing_without_a_robot_has_no_effect() -> None:
    sharing = SharingFleet(shared=False)
    sharing.fleet.execute(sharing.driver, ShareControl(True), 0.0)
    with pytest.raises(RejectedError, match="does not share"):
        sharing.drive(sharing.driver)
