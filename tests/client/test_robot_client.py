"""The robot client against a scripted server."""

from __future__ import annotations

import math
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from catoptra_client.robot_client import RobotClient
from catoptra_protocol.camera_conf import pairs_from_omni_camera
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    LocalProtocolError,
    RemoteProtocolError,
)
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.usarsim.commands import (
    Drive,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    Note,
    ShareControl,
    StepCommand,
)
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Configuration,
    Geometry,
    GeometryItem,
    GroundTruthReading,
    InitResult,
    OdometryReading,
    Report,
    StartPose,
    StartPoses,
    VehicleGeometry,
    VehicleStatus,
)
from client.scripted_server import GREETING, ScriptedControlPeer, serve_script, wait_for_close

SHORT_S = 0.05  # a timeout that is meant to pass

STATUS = VehicleStatus(1.0, 1200)
ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)
GROUND_TRUTH = GroundTruthReading(1.0, "GroundTruth", (4.5, 1.9, 1.85), (0.0, 0.0, 1.5), decimals=4)
STEP_OK = CommandResult(1.2, "Step", "Clock")
P2AT = VehicleGeometry("P2AT", (0.5, 0.5, 0.3), (0.0, 0.0, 0.0), 0.13, 0.4712, 0.2884)
CAMERA = camera_with_inscribed_rim(
    HyperbolicMirror(11.546, 2.321), width_px=360, height_px=360, rim_rad=math.radians(125.0)
)


@contextmanager
def connect(
    *replies: tuple[object, tuple[Report, ...]], timeout_s: float = 5.0
) -> Iterator[RobotClient]:
    """Client of a server that expects each command in turn and sends the reports for it."""

    def script(connection: socket.socket) -> None:
        control = ScriptedControlPeer(connection)
        for command, reports in replies:
            assert control.receive_command() == command
            control.send(*reports)
        wait_for_close(connection)

    with serve_script(script) as port, RobotClient.connect(port=port, timeout_s=timeout_s) as robot:
        yield robot


@contextmanager
def spawn(*replies: tuple[object, tuple[Report, ...]]) -> Iterator[RobotClient]:
    """Client with a robot, of such a server."""
    with connect((Init("P2AT"), (STATUS,)), *replies) as robot:
        robot.spawn("P2AT")
        yield robot


def test_connect_when_greeted_knows_the_level() -> None:
    with connect() as robot:
        assert robot.greeting == GREETING
        assert (robot.status, robot.odometry, robot.ground_truth) == (None, None, None)


def test_connect_when_nothing_listens_names_the_remedy() -> None:
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))  # bound, not listening: refused
        with pytest.raises(ConnectionLostError, match="start catoptra-server"):
            RobotClient.connect(port=bound.getsockname()[1])


@pytest.mark.parametrize(
    ("script", "message"),
    [
        (wait_for_close, "is this the control port"),
        (lambda connection: None, "lost the control server"),
    ],
    ids=["silent", "closes"],
)
def test_connect_when_the_server_does_not_greet_has_the_reason(
    script: Callable[[socket.socket], None], message: str
) -> None:
    with serve_script(script) as port, pytest.raises(ConnectionLostError, match=message):
        RobotClient.connect(port=port, timeout_s=SHORT_S)


def test_start_poses_when_requested_are_returned() -> None:
    poses = StartPoses((StartPose("Robot1", (1.0, 2.0, 0.0), (0.0, 0.0, 1.5)),))
    with connect((GetStartPoses(), (poses,))) as robot:
        assert robot.get_start_poses() == poses


def test_spawn_when_the_robot_reports_returns() -> None:
    init = Init("USARBot.P2AT", "R1", (4.5, 1.9, 1.8), (0.0, 0.0, 1.57))
    with connect((init, (STATUS,))) as robot:
        robot.spawn(
            "USARBot.P2AT", name="R1", location_m=(4.5, 1.9, 1.8), rotation_rad=(0.0, 0.0, 1.57)
        )
        assert robot.status == STATUS


def test_spawn_when_the_server_does_not_reply_explains_the_rejection() -> None:
    with connect((Init("Nothing", start="Nowhere"), ()), timeout_s=SHORT_S) as robot:
        with pytest.raises(CatoptraError, match="does not reply to an unknown class or start"):
            robot.spawn("Nothing", start_pose="Nowhere")


def test_spawn_when_rejected_has_the_reason_at_once_and_another_may_follow() -> None:
    rejection = InitResult(1.0, failure="there is no class 'P2A'; did you mean P2AT?")
    moved = InitResult(1.0, "R1", (0.5, 1.4, -0.25))
    replies = ((Init("P2A"), (rejection,)), (Init("P2AT"), (moved, STATUS)))
    with connect(*replies) as robot:
        with pytest.raises(CatoptraError, match=r"no robot: there is no class 'P2A'; did you mean"):
            robot.spawn("P2A")
        assert robot.spawn("P2AT") == (0.5, 1.4, -0.25)


def test_camera_when_unknown_is_rejected_with_the_names_of_the_robot() -> None:
    empty = Configuration("Camera", (("Name", "Frnt"),))
    items = (GeometryItem("Front", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),)
    geometry = Geometry("Camera", items)
    replies = (GetConf("Camera", "Frnt"), (empty,)), (GetGeo("Camera"), (geometry,))
    with spawn(*replies) as robot:
        with pytest.raises(RemoteProtocolError, match="robot has Front"):
            robot.get_camera("Frnt")


def test_spawn_when_the_connection_has_a_robot_is_rejected() -> None:
    with spawn() as robot:
        with pytest.raises(LocalProtocolError, match="open another connection"):
            robot.spawn("P2AT")


def test_drive_when_called_sends_both_sides() -> None:
    drive = Drive(50.0, -50.0, normalized=True)
    with spawn((drive, (ODOMETRY,))) as robot:
        robot.drive(50.0, -50.0, normalized=True)
        assert robot.wait_for_report(OdometryReading) == ODOMETRY


def test_note_and_sharing_are_sent() -> None:
    note = Note("ekf", '{"pose":[1.0,2.0,0.5]}')
    with spawn((note, ()), (ShareControl(True), ()), (ShareControl(False), (ODOMETRY,))) as robot:
        robot.publish("ekf", {"pose": np.array([1.0, 2.0, 0.5])})
        robot.share_control()
        robot.share_control(False)
        assert robot.wait_for_report(OdometryReading) == ODOMETRY


def test_note_when_the_server_would_ignore_it_is_not_sent() -> None:
    notes = [(Note(f"note {number}", "{}"), ()) for number in range(8)]
    with spawn(*notes, (Note("note 3", "{}"), (ODOMETRY,))) as robot:
        with pytest.raises(LocalProtocolError, match="no JSON object"):
            robot.publish("nan", {"pose": math.nan})
        for number in range(8):
            robot.publish(f"note {number}", {})
        with pytest.raises(LocalProtocolError, match="8 names"):
            robot.publish("ninth", {})
        robot.publish("note 3", {})
        assert robot.wait_for_report(OdometryReading) == ODOMETRY


def test_step_returns_the_reports_before_its_result() -> None:
    with spawn((StepCommand(0.2), (ODOMETRY, GROUND_TRUTH, STATUS, STEP_OK))) as robot:
        assert robot.step(0.2) == [ODOMETRY, GROUND_TRUTH, STATUS]
        assert (robot.odometry, robot.ground_truth, robot.status) == (
            ODOMETRY,
            GROUND_TRUTH,
            STATUS,
        )


def test_step_when_before_spawn_is_served() -> None:
    with connect((StepCommand(0.2), (STEP_OK,))) as robot:
        assert robot.step(0.2) == []


def test_step_when_failed_tells_how_to_run_the_server() -> None:
    failed = CommandResult(1.2, "Step", "Clock", "Failed")
    with connect((StepCommand(0.2), (failed,))) as robot:
        with pytest.raises(CatoptraError, match="--clock lockstep"):
            robot.step(0.2)


def test_step_when_unsupported_by_the_server_times_out() -> None:
    with (
        connect((StepCommand(0.2), ()), timeout_s=SHORT_S) as robot,
        pytest.raises(ConnectionLostError, match="is it Catoptra"),
    ):
        robot.step(0.2)


def test_wait_for_when_reports_came_in_one_segment_reads_on_in_it() -> None:
    with connect((Init("P2AT"), (STATUS, ODOMETRY, GROUND_TRUTH, ODOMETRY))) as robot:
        robot.spawn("P2AT")
        assert robot.wait_for_report(GroundTruthReading) == GROUND_TRUTH
        assert robot.wait_for_report(OdometryReading) == ODOMETRY


def test_wait_for_when_only_others_come_ends_in_time() -> None:
    ticks = iter(range(100))

    def script(connection: socket.socket) -> None:
        ScriptedControlPeer(connection).send(*[ODOMETRY] * 100)
        wait_for_close(connection)

    with serve_script(script) as port, socket.create_connection(("127.0.0.1", port)) as connection:
        robot = RobotClient(connection, timeout_s=0.03, clock=lambda: 0.01 * next(ticks))
        with pytest.raises(ConnectionLostError, match="did not send a VehicleStatus"):
            robot.wait_for_report(VehicleStatus)


def test_wait_when_the_server_disconnects_names_the_remedy() -> None:
    def script(connection: socket.socket) -> None:
        control = ScriptedControlPeer(connection)
        control.receive_command()
        control.send(STATUS)

    with serve_script(script) as port, RobotClient.connect(port=port) as robot:
        robot.spawn("P2AT")
        with pytest.raises(ConnectionLostError, match="connect and spawn again"):
            robot.wait_for_report(OdometryReading)


def test_wait_for_when_a_report_is_malformed_names_the_field_and_can_go_on() -> None:
    def script(connection: socket.socket) -> None:
        control = ScriptedControlPeer(connection)
        connection.sendall(b"STA {Type GroundVehicle} {Time 1.0}\r\n")
        control.send(ODOMETRY)
        wait_for_close(connection)

    with serve_script(script) as port, RobotClient.connect(port=port) as robot:
        with pytest.raises(RemoteProtocolError, match="Battery"):
            robot.wait_for_report(VehicleStatus)
        assert robot.wait_for_report(OdometryReading) == ODOMETRY


OTHER_CAMERA, CAMERA_TILE = (Configuration("Camera", (("Name", n),)) for n in ("Omni", "Rear"))


@pytest.mark.parametrize(
    ("request_", "others", "answer"),
    [
        (GetConf("odometry"), (STATUS, OTHER_CAMERA), Configuration("Odometry", (("Name", "O"),))),
        # The type of a vehicle is free text.
        (GetConf("Robot", "R1"), (), Configuration("GroundVehicle", (("Name", "P2AT"),))),
        (GetConf("Camera", "rear"), (OTHER_CAMERA,), CAMERA_TILE),
    ],
    ids=["sensor", "robot", "camera"],
)
def test_configuration_when_others_come_between_is_the_requested_one(
    request_: GetConf, others: tuple[Report, ...], answer: Configuration
) -> None:
    with spawn((request_, (*others, answer))) as robot:
        assert robot.get_configuration(request_.type, request_.name) == answer


def test_geometry_when_of_sensors_or_of_the_robot_is_returned() -> None:
    sonar = Geometry("Sonar", (GeometryItem("F1", (0.1, 0.0, 0.0), (0.0, 0.0, 0.5)),))
    with spawn((GetGeo("Sonar"), (sonar,)), (GetGeo("Robot"), (P2AT,))) as robot:
        assert robot.get_geometry("Sonar") == sonar
        assert robot.get_geometry("Robot") == P2AT


def test_camera_when_requested_is_the_servers_model() -> None:
    pairs = (("Name", "Omni"), *pairs_from_omni_camera(CAMERA, 0.55))
    conf = Configuration("Camera", pairs)
    with spawn(*[(GetConf("Camera"), (conf,))] * 2) as robot:
        assert robot.get_camera() == CAMERA
        assert robot.get_camera_and_height() == (CAMERA, 0.55)


def test_camera_when_not_omnidirectional_names_the_missing_keys() -> None:
    conf = Configuration("Camera", (("Name", "Camera"), ("CameraFov", "80.0000")))
    with spawn((GetConf("Camera", "Camera"), (conf,))) as robot:
        with pytest.raises(RemoteProtocolError, match="Mirror"):
            robot.get_camera("Camera")
