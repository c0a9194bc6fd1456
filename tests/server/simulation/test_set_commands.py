"""SET: results OK and Failed."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.commands import Drive, Set
from catoptra_protocol.usarsim.reports import (
    EncoderReadings,
    InsReading,
    OdometryReading,
    line_from_report,
)
from catoptra_server.render.render_settings import AccuracyTarget
from catoptra_server.simulation.commands import execute_set
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import (
    Mount,
    PerspectiveCameraDescription,
    PlanarPose,
)
from catoptra_server.world.obstacle_grid import build_obstacle_grid
from catoptra_server.world.scene_mesh import build_scene
from helpers.robots import ENCODER, INS, ODOMETRY, SCANNER, make_p2at, make_walled_world

CAMERA = PerspectiveCameraDescription("Camera", Mount(), 320, 240, 1.3963, 0.3491, 2.0944)


def drive_robot() -> Robot:
    """Robot that has moved 0.26 m."""
    description = make_p2at(
        sensors=(SCANNER, INS, ODOMETRY, ENCODER), perspective_cameras=(CAMERA,)
    )
    robot = Robot(description, PlanarPose(0.0, 0.0, 0.0), name="R", seed=1, time_s=0.0)
    free = build_obstacle_grid(build_scene(make_walled_world()), low_m=0.03, high_m=1.0)
    robot.drive_wheels(Drive(2.0, 2.0), 0.0)
    for tick in range(1, 51):
        robot.step(0.02, 0.02 * tick, free)
    return robot


def execute(robot: Robot, command: Set) -> str:
    reports = execute_set(robot, command, robot.sensor_context(1.0))
    return b"".join(map(line_from_report, reports)).decode().replace("1.0000", "1.00")


def read(robot: Robot, kind: type) -> object:
    return next(r for r in robot.read_all(1.0) if isinstance(r, kind))


def test_odometry_when_reset_is_zero() -> None:
    robot = drive_robot()
    answer = execute(robot, Set("Odometry", "odometry", "RESET"))
    assert answer == "RES {Time 1.00} {Type Odometry} {Name odometry} {Status OK}\r\n"
    assert read(robot, OdometryReading) == OdometryReading("Odometry", 0, 0, 0, time_s=1.0)


def test_encoder_when_reset_is_zero() -> None:
    robot = drive_robot()
    assert read(robot, EncoderReadings) == EncoderReadings((("ECLeft", 114),), 1.0)
    assert "{Status OK}" in execute(robot, Set("Encoder", None, "Reset"))
    assert read(robot, EncoderReadings) == EncoderReadings((("ECLeft", 0),), 1.0)


def test_ins_when_set_to_a_pose_reports_the_pose() -> None:
    robot = drive_robot()
    assert "{Status OK}" in execute(robot, Set("INS", "INS", "POSE", "1,2,0,0,0,0.5"))
    ins = read(robot, InsReading)
    assert isinstance(ins, InsReading)
    assert ins.location_m[:2] == pytest.approx((1.0, 2.0))


def test_camera_when_zoomed_confirms_the_field_of_view() -> None:
    robot = drive_robot()
    answer = execute(robot, Set("Camera", "Camera", fov_rad=0.7853))
    assert answer == ("RES {Time 1.00} {Type Camera} {Name Camera} {FOV 0.7853} {Status OK}\r\n")
    assert "{FOV 1.3963}" in execute(robot, Set("camera", None, "ZOOM", "0"))


def test_scan_when_requested_precedes_its_result() -> None:
    answer = execute(drive_robot(), Set("RangeScanner", "Scanner1", "SCAN"))
    assert [line.split()[0] for line in answer.splitlines()] == ["SEN", "RES"]


@pytest.mark.parametrize(
    "command",
    [
        Set("Toaster", "T", "ON"),
        Set("Odometry", "Odometry", "EXPLODE"),
        Set("Odometry", "Other", "RESET"),
        Set("Encoder", "Other", "RESET"),
        Set("INS", "INS", "POSE", "1,2,3"),
        Set("Camera", "Other", fov_rad=1.0),
        Set("Camera", "Camera"),
        Set("RangeScanner", "Other", "SCAN"),
        Set(""),
    ],
)
def test_command_when_impossible_has_the_result_failed(command: Set) -> None:
    answer = execute(drive_robot(), command)
    assert answer.startswith("RES {Time 1.00}")
    assert answer.endswith("{Status Failed}\r\n")


def accuracy_target(robot: Robot) -> AccuracyTarget:
    return robot.omni_cameras[0].camera_spec().render_settings.accuracy_target


def test_omni_camera_when_set_to_a_target_is_rendered_by_the_target() -> None:
    robot = drive_robot()
    answer = execute(robot, Set("Camera", "OmniCam", "MaxError", "0.5"))
    assert answer == "RES {Time 1.00} {Type Camera} {Name OmniCam} {Status OK}\r\n"
    assert "{Status OK}" in execute(robot, Set("camera", None, "BUDGET", "20"))
    assert accuracy_target(robot) == AccuracyTarget(0.5, 20.0)
    assert "{Status OK}" in execute(robot, Set("Camera", "omnicam", "MaxError", "0"))
    assert accuracy_target(robot) == AccuracyTarget(0.0, 20.0)


@pytest.mark.parametrize(
    ("name", "params"),
    [("OmniCam", "-1"), ("OmniCam", "1,2"), ("OmniCam", None), ("Camera", "1")],
)
def test_accuracy_target_when_invalid_has_the_result_failed_and_stays(
    name: str, params: str | None
) -> None:
    robot = drive_robot()
    assert "{Status Failed}" in execute(robot, Set("Camera", name, "MaxError", params))
    assert accuracy_target(robot) == AccuracyTarget()
