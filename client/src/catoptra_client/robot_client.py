"""Client of one robot on a Catoptra or USARSim server, over TCP: spawn, drive, read sensors.

Calls block; one connection is one robot, for one thread. Nothing is read between calls: a call
reads until the expected report arrives and keeps the latest reading of every sensor on the way.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from typing import TypeVar

from catoptra_client.control_connection import ControlConnection, ReplyTimeoutError, open_connection
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.errors import CatoptraError, LocalProtocolError, RemoteProtocolError
from catoptra_protocol.names import list_names
from catoptra_protocol.notes import check_note_count, text_from_note
from catoptra_protocol.optics.omni_camera import OmniCamera
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
    Greeting,
    GroundTruthReading,
    InitResult,
    InsReading,
    OdometryReading,
    Report,
    StartPoses,
    VehicleGeometry,
    VehicleStatus,
)
from catoptra_protocol.vectors import Vector3

_ReportT = TypeVar("_ReportT", bound=Report)


class RobotClient:
    """One robot on a control port, from `connect` to `close`; also a context manager.

    For one thread. It speaks USARSim's protocol, to our server and to others; images come from
    `ImageClient`. With a Catoptra server `StreamClient` has images, readings and errors with
    reasons on one connection.

    Every method that sends or waits raises as follows.

    Raises:
        ConnectionLostError: The server disconnected. The server has removed the robot: connect and
            spawn again.
        ReplyTimeoutError: A ConnectionLostError too: the expected report did not arrive within
            `timeout_s`, on a connection that still exists. Reports that were read meanwhile are
            lost but for the latest of each type (`odometry`, `status`).
        LocalProtocolError: A command has no form on the wire, such as a speed that is not finite.
            Nothing was sent.
        RemoteProtocolError: A report is malformed. The reports behind it can be read by the next
            call.

    KeyboardInterrupt ends any wait; the next call continues. USARSim's replies have no ids, so a
    reply that arrives after its timeout is taken for that of the next command of the kind: after a
    ReplyTimeoutError of `step`, `get_configuration` or `get_geometry` connect anew. After `close`
    every method raises ConnectionLostError.

    Example:
        ```python
        with RobotClient.connect("127.0.0.1", 3000) as robot:
            robot.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
            robot.drive(2.0, 2.0)
            print(robot.wait_for_report(OdometryReading))
        ```
    """

    def __init__(
        self,
        connection: socket.socket,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take ownership of a connected socket.

        Args:
            connection: connected TCP socket.
            timeout_s: time limit of each wait.
            clock: monotonic clock in seconds, which measures the limits.
        """
        self._connection = ControlConnection(connection, timeout_s=timeout_s, clock=clock)
        self._published: dict[str, None] = {}

    @classmethod
    def connect(
        cls, host: str = "127.0.0.1", port: int = 3000, timeout_s: float = 5.0
    ) -> RobotClient:
        """Connect to a control port and wait for the greeting; the robot is not spawned yet.

        Args:
            host: Host name or address.
            port: Control port.
            timeout_s: Limit of connecting, and of each wait of this and later calls.

        Raises:
            ConnectionLostError: No server listens there. It is not tried again: a program that
                starts with its server waits itself, or uses `server_process.run_server`.
            ReplyTimeoutError: The peer sends no greeting: another port, such as the image port.

        An exception closes the connection.
        """
        robot = cls(
            open_connection(host, port, timeout_s, server_kind="control"), timeout_s=timeout_s
        )
        # Any port accepts a connection; only the control port greets.
        try:
            robot._connection.wait_for_report(Greeting, "a greeting (is this the control port?)")
        except CatoptraError:
            # The caller has no object to close yet.
            robot.close()
            raise
        return robot

    def close(self) -> None:
        """Close the connection; the server removes the robot. May be called twice."""
        self._connection.close()

    def __enter__(self) -> RobotClient:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    @property
    def greeting(self) -> Greeting | None:
        """Greeting of the server, with game type and level."""
        return self._connection.get_latest(Greeting)

    @property
    def odometry(self) -> OdometryReading | None:
        """Latest odometry received; None before the first."""
        return self._connection.get_latest(OdometryReading)

    @property
    def ground_truth(self) -> GroundTruthReading | None:
        """Latest ground truth received; None before the first."""
        return self._connection.get_latest(GroundTruthReading)

    @property
    def ins(self) -> InsReading | None:
        """Latest INS reading received, with roll and pitch; None before the first."""
        return self._connection.get_latest(InsReading)

    @property
    def status(self) -> VehicleStatus | None:
        """Latest status received; None before the first."""
        return self._connection.get_latest(VehicleStatus)

    def get_start_poses(self) -> StartPoses:
        """Named start poses of the world, for `spawn`; also before a robot is spawned.

        Raises:
            ReplyTimeoutError: The server did not reply in time.
        """
        self._connection.send(GetStartPoses())
        return self._connection.wait_for_report(StartPoses, "the start poses")

    def spawn(
        self,
        class_name: str,
        *,
        name: str | None = None,
        location_m: Vector3 | None = None,
        rotation_rad: Vector3 = (0.0, 0.0, 0.0),
        start_pose: str | None = None,
    ) -> Vector3 | None:
        """Spawn the robot and wait for its first status or reading.

        Args:
            class_name: Robot class in the server's configuration, such as `USARBot.OmniP2AT`.
            name: Name of the robot; the server chooses one if None.
            location_m: Position in the world frame; None to use a start pose.
            rotation_rad: Roll, pitch, yaw.
            start_pose: Name of a start pose of the world.

        Returns:
            Location of the robot in metres where the requested one was not free, else None. A
            USARSim server does not say it.

        Raises:
            LocalProtocolError: This connection has a robot already: connect again for another.
            CatoptraError: There is no such class or start; the reason names those that there are,
                and another call may follow. A USARSim server does not reply, which raises after
                `timeout_s`.
        """
        # USARSim has no reply to INIT: the first report of a robot is the only confirmation.
        if any(_is_robot_report(report) for report in self._connection.latest_reports):
            raise LocalProtocolError("this connection has a robot already: open another connection")
        self._connection.send(Init(class_name, name, location_m, rotation_rad, start_pose))
        try:
            reports = self._connection.wait_until(_ends_spawn, "a report of the robot")
        except ReplyTimeoutError as error:
            raise CatoptraError(
                f"{self._connection.peer} did not spawn {class_name!r} within "
                f"{self._connection.timeout_s:g} s. USARSim does not reply to an unknown class or "
                "start: check both against the server's configuration and log"
            ) from error
        result = next((report for report in reports if isinstance(report, InitResult)), None)
        if result is not None and result.failure:
            raise CatoptraError(f"{self._connection.peer} spawned no robot: {result.failure}")
        return result.moved_to if result else None

    def drive(self, left_rad_s: float, right_rad_s: float, normalized: bool = False) -> None:
        """Set the wheel speeds of a differential drive, which hold until the next call.

        Returns when the command is sent, not when it is executed: there is no reply. In lockstep
        nothing moves before `step`.

        Args:
            left_rad_s: Speed of the left wheels; in percent of the maximum if normalized.
            right_rad_s: Speed of the right wheels, likewise.
            normalized: Interpret speeds as percentages, -100 to 100.

        Raises:
            LocalProtocolError: A speed is not finite; nothing was sent.
        """
        self._connection.send(Drive(left_rad_s, right_rad_s, normalized))

    def publish(self, name: str, note: Mapping[str, object]) -> None:
        """Publish a note about the robot, such as the belief of its localization, to all viewers.

        Catoptra only: a USARSim server ignores it. A note replaces the one of the same name.

        Args:
            name: Name of the note, at most 64 printable characters.
            note: Values of JSON, numbers and arrays of NumPy; SPEC.md 9.7 lists the keys that
                viewers draw.

        Raises:
            LocalProtocolError: The note has more than 8 KiB of JSON or a number that is not finite,
                or is one too many: 8 names per robot. Nothing was sent.

        Before `spawn` the server ignores a note, without an error.
        """
        text = text_from_note(name, note)
        # Checked here: the control port has no reply to a note.
        check_note_count(self._published, name)
        self._connection.send(Note(name, text))
        self._published[name] = None

    def share_control(self, shared: bool = True) -> None:
        """Let other clients and viewers drive the robot, or no longer; it halts then.

        Catoptra only: a USARSim server ignores it. There is no reply.

        Args:
            shared: Whether others may drive it.
        """
        self._connection.send(ShareControl(shared))

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep server by simulated seconds; reports received during the step.

        All robots of the server advance. In real time use `wait_for_report` instead.

        Args:
            time_s: Simulated seconds, 0 to 60.

        Raises:
            CatoptraError: The server rejects the step, or does not run in lockstep.
            ReplyTimeoutError: The step takes longer than `timeout_s`, or the server is USARSim's,
                which knows no STEP. It may still be executed: connect anew instead of repeating it.

        Example:
            ```python
            for _ in range(50):
                reports = robot.step(0.1)
                scans = [r for r in reports if isinstance(r, RangeScanReading)]
            ```
        """
        self._connection.send(StepCommand(time_s))
        reports = self._connection.wait_until(_is_step_result, _STEP_RESULT)
        # The last report is the result of STEP itself, which confirms that the step is complete.
        result = reports.pop()
        if isinstance(result, CommandResult) and result.status != "OK":
            raise CatoptraError(
                f"{self._connection.peer} did not step by {time_s:g} s (status {result.status}): "
                "run the server with --clock lockstep, and step by at most a minute"
            )
        return reports

    def wait_for_report(
        self, report_type: type[_ReportT], timeout_s: float | None = None
    ) -> _ReportT:
        """Next report of this type that has not been read yet.

        Reports of other types on the way are kept as the latest of theirs. A slow program reads old
        reports, in order: for the newest use `odometry`, `ground_truth` or `status` after a call
        that waits, or a `StreamClient`.

        Args:
            report_type: Class of the report.
            timeout_s: Time limit; that of the client if None.

        Raises:
            ReplyTimeoutError: None arrived in time: the robot has no such sensor, is not spawned,
                or the server's lockstep clock stands still. Call again to go on waiting.

        Example:
            ```python
            scan = robot.wait_for_report(RangeScanReading, timeout_s=1.0)
            ```
        """
        return self._connection.wait_for_report(
            report_type, f"a {report_type.__name__}", timeout_s=timeout_s
        )

    def get_configuration(self, type_: str, name: str | None = None) -> Configuration:
        """Configuration of the `Robot`, of all sensors of a type, or of one sensor.

        Args:
            type_: Type of the sensors, such as `Camera`, or `Robot`, in any case.
            name: Name of one sensor; None for all.

        Returns:
            The reply; from our server it has no values for an unknown type or name.

        Raises:
            ReplyTimeoutError: There is no robot: `spawn` first. A USARSim server may not reply to
                an unknown type either.
        """
        self._connection.send(GetConf(type_, name))
        return self._connection.wait_for_report(
            Configuration,
            f"the configuration of {type_} {name or ''}",
            lambda report: _matches_type(type_, report.type) and _has_camera_name(name, report),
        )

    def get_geometry(self, type_: str, name: str | None = None) -> Geometry | VehicleGeometry:
        """Mounting poses of the sensors of a type, or the geometry of the `Robot` itself.

        Args:
            type_: Type of the sensors, or `Robot`, in any case.
            name: Name of one sensor; None for all.

        Returns:
            The reply; from our server it has no values for an unknown type or name.

        Raises:
            ReplyTimeoutError: There is no robot: `spawn` first. A USARSim server may not reply to
                an unknown type either.
        """
        self._connection.send(GetGeo(type_, name))
        description = f"the geometry of {type_} {name or ''}"
        if type_.lower() == "robot":
            return self._connection.wait_for_report(VehicleGeometry, description)
        return self._connection.wait_for_report(
            Geometry, description, lambda report: _matches_type(type_, report.type)
        )

    def get_camera(self, name: str | None = None) -> OmniCamera:
        """Model of the omnidirectional camera: projection of directions to pixels, and back.

        Catoptra only, since USARSim's configurations have no model. For a camera without a mirror
        use `StreamClient.get_camera`.

        Args:
            name: Name of the camera; None for the first in the reply.

        Raises:
            RemoteProtocolError: There is no such camera, or its configuration has no model of an
                omnidirectional one.
            ReplyTimeoutError: There is no robot: `spawn` first.
        """
        return self.get_camera_and_height(name)[0]

    def get_camera_and_height(self, name: str | None = None) -> tuple[OmniCamera, float]:
        """Model of the omnidirectional camera, and the height of its viewpoint over the floor in
        metres.

        Args and errors are those of `get_camera`.
        """
        # Both from one reply: the height is a pair of the camera's configuration.
        pairs = self.get_configuration("Camera", name).pairs
        if name and pairs in ((), (("Name", name),)):
            geometry = self.get_geometry("Camera")
            items = geometry.items if isinstance(geometry, Geometry) else ()
            names = list_names(name, (item.name for item in items))
            raise RemoteProtocolError(f"there is no camera {name!r}: the robot has {names}")
        return omni_camera_from_pairs(pairs)


# Completes the timeout's message: servers in real time, and USARSim, do not reply to STEP.
_STEP_RESULT = "the result of STEP (is it Catoptra, run with --clock lockstep?)"


def _is_robot_report(report: Report) -> bool:
    return isinstance(report, VehicleStatus | OdometryReading | GroundTruthReading)


def _ends_spawn(report: Report) -> bool:
    is_rejection = isinstance(report, InitResult) and bool(report.failure)
    return is_rejection or _is_robot_report(report)


def _is_step_result(report: Report) -> bool:
    # USARSim's names are case-insensitive, here and below.
    return isinstance(report, CommandResult) and report.type.lower() == "step"


def _has_camera_name(requested_name: str | None, report: Configuration) -> bool:
    """Whether a reply concerns the requested camera; the server also sends those of all tiles."""
    if requested_name is None or report.type.lower() != "camera":
        return True
    return requested_name.lower() == (report.get("Name") or "").lower()


def _matches_type(requested_type: str, reply_type: str) -> bool:
    """Whether a reply's type matches the request; replies for `Robot` have the vehicle's type."""
    return requested_type.lower() in (reply_type.lower(), "robot")
