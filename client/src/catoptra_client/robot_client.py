"""Client of one robot on a Catoptra or USARSim server, over TCP: spawn, drive, read sensors.

Calls block; one connection is one robot, for one thread. Nothing is read between calls: a call
reads until the expected report arrives and keeps the latest reading of every sensor on the way.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self, TypeVar

from catoptra_client.control_connection import ControlConnection, ReplyTimeoutError, open_connection
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.errors import CatoptraError, LocalProtocolError
from catoptra_protocol.notes import find_note_count_error, text_from_note
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.usarsim.commands import (
    Drive,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    Note,
    ShareControl,
    Step,
)
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Configuration,
    Geometry,
    Greeting,
    GroundTruthReading,
    OdometryReading,
    Report,
    StartPoses,
    VehicleGeometry,
    VehicleStatus,
)
from catoptra_protocol.vectors import Vector3

_ReportT = TypeVar("_ReportT", bound=Report)


class RobotClient:
    """One robot, from `connect` to `close`; also a context manager.

    Calls that wait raise ConnectionLostError if the server disconnects or sends nothing for
    `timeout_s`, and RemoteProtocolError if the server violates the protocol.
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
    def connect(cls, host: str = "127.0.0.1", port: int = 3000, timeout_s: float = 5.0) -> Self:
        """Connect to a control port and wait for the greeting; the robot is not spawned yet.

        Raises:
            ConnectionLostError: no server listens there, or the peer sends no greeting.
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
        """Close the connection; the server removes the robot."""
        self._connection.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
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
    def status(self) -> VehicleStatus | None:
        """Latest status received; None before the first."""
        return self._connection.get_latest(VehicleStatus)

    def get_start_poses(self) -> StartPoses:
        """Named start poses of the world."""
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
    ) -> None:
        """Spawn the robot and wait for the first status or reading.

        Args:
            class_name: robot class in the server's configuration, such as `USARBot.OmniP2AT`.
            name: name of the robot; the server chooses one if None.
            location_m: position in the world frame; None to use a start pose.
            rotation_rad: roll, pitch, yaw.
            start_pose: name of a start pose of the world.

        Raises:
            LocalProtocolError: this connection has a robot already.
            CatoptraError: the server did not spawn the robot in time.
        """
        # USARSim has no reply to INIT: the first report of a robot is the only confirmation.
        if any(_is_robot_report(report) for report in self._connection.latest_reports):
            raise LocalProtocolError("this connection has a robot already: open another connection")
        self._connection.send(Init(class_name, name, location_m, rotation_rad, start_pose))
        try:
            self._connection.wait_until(_is_robot_report, "a report of the robot")
        except ReplyTimeoutError as error:
            raise CatoptraError(
                f"{self._connection.peer} did not spawn {class_name!r} within "
                f"{self._connection.timeout_s:g} s. The server does not reply to an unknown class "
                "or start: check both against the server's configuration and log"
            ) from error

    def drive(self, left_rad_s: float, right_rad_s: float, normalized: bool = False) -> None:
        """Set the wheel speeds of a differential drive.

        Args:
            left_rad_s: speed of the left wheels; in percent of the maximum if normalized.
            right_rad_s: speed of the right wheels, likewise.
            normalized: interpret speeds as percentages, -100 to 100.
        """
        self._connection.send(Drive(left_rad_s, right_rad_s, normalized))

    def publish(self, name: str, note: Mapping[str, object]) -> None:
        """Publish a note about the robot, such as the belief of its localization, to all viewers.

        Catoptra only: a USARSim server ignores it. A note replaces the one of the same name.

        Args:
            name: name of the note, at most 64 printable characters.
            note: values of JSON, numbers and arrays of NumPy; SPEC.md 9.7 lists the keys that
                viewers draw.

        Raises:
            LocalProtocolError: the note has more than 8 KiB of JSON or a number that is not finite,
                or is one too many: 8 names a robot.
        """
        text = text_from_note(name, note)
        # Checked here: the control port has no reply to a note.
        reason = find_note_count_error(self._published, name)
        if reason:
            raise LocalProtocolError(reason)
        self._connection.send(Note(name, text))
        self._published[name] = None

    def share_control(self, shared: bool = True) -> None:
        """Let other clients and viewers drive the robot, or no longer; it halts then.

        Catoptra only: a USARSim server ignores it.
        """
        self._connection.send(ShareControl(shared))

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep server by simulated seconds; reports received during the step.

        Raises:
            CatoptraError: the server rejects the step, or does not run in lockstep.
        """
        self._connection.send(Step(time_s))
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
        """Next report of this type that has not been read yet."""
        return self._connection.wait_for_report(
            report_type, f"a {report_type.__name__}", timeout_s=timeout_s
        )

    def get_configuration(self, type_: str, name: str | None = None) -> Configuration:
        """Configuration of the `Robot`, of all sensors of a type, or of one sensor."""
        self._connection.send(GetConf(type_, name))
        return self._connection.wait_for_report(
            Configuration,
            f"the configuration of {type_} {name or ''}",
            lambda report: _matches_type(type_, report.type) and _has_camera_name(name, report),
        )

    def get_geometry(self, type_: str, name: str | None = None) -> Geometry | VehicleGeometry:
        """Mounting poses of the sensors of a type, or the geometry of the `Robot` itself."""
        self._connection.send(GetGeo(type_, name))
        description = f"the geometry of {type_} {name or ''}"
        if type_.lower() == "robot":
            return self._connection.wait_for_report(VehicleGeometry, description)
        return self._connection.wait_for_report(
            Geometry, description, lambda report: _matches_type(type_, report.type)
        )

    def get_camera(self, name: str | None = None) -> OmniCamera:
        """Model of the omnidirectional camera."""
        return self.get_camera_and_height(name)[0]

    def get_camera_and_height(self, name: str | None = None) -> tuple[OmniCamera, float]:
        """Model of the omnidirectional camera, and the height of its viewpoint over the floor in
        metres.
        """
        # Both from one reply: the height is a pair of the camera's configuration.
        return omni_camera_from_pairs(self.get_configuration("Camera", name).pairs)


# Completes the timeout's message: servers in real time, and USARSim, do not reply to STEP.
_STEP_RESULT = "the result of STEP (is it Catoptra, run with --clock lockstep?)"


def _is_robot_report(report: Report) -> bool:
    return isinstance(report, VehicleStatus | OdometryReading | GroundTruthReading)


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
