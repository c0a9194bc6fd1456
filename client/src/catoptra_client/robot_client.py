"""A robot on a Catoptra or USARSim server: spawn it, drive it, read its sensors, over TCP.

Blocking, one connection = one robot, for one thread. Nothing is read between calls: each call reads
until it has what it asked for, and on its way keeps the newest reading of every sensor.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from catoptra_client.control_connection import ControlConnection, ReplyTimeoutError
from catoptra_client.tcp import open_connection
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.errors import CatoptraError, LocalProtocolError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.usarsim.commands import (
    Drive,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
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

    Every call that waits raises ConnectionLostError if the server goes away or stays silent for
    `timeout_s`, and RemoteProtocolError if it sends what no server of ours would.
    """

    def __init__(
        self,
        connection: socket.socket,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take over a connected socket. `clock` counts seconds and measures the timeouts."""
        self._connection = ControlConnection(connection, timeout_s=timeout_s, clock=clock)

    @classmethod
    def connect(cls, host: str = "127.0.0.1", port: int = 3000, timeout_s: float = 5.0) -> Self:
        """Return a robot still to be spawned, once the server has greeted."""
        robot = cls(
            open_connection(host, port, timeout_s, server_kind="control"), timeout_s=timeout_s
        )
        try:
            robot._connection.wait_for_report(Greeting, "a greeting (is this the control port?)")
        except CatoptraError:
            robot.close()
            raise
        return robot

    def close(self) -> None:
        """End the connection: the server removes the robot."""
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
        """Return what the server said first: the game type and the level."""
        return self._connection.get_latest(Greeting)

    @property
    def odometry(self) -> OdometryReading | None:
        """Return the newest odometry that was read; None before the first."""
        return self._connection.get_latest(OdometryReading)

    @property
    def ground_truth(self) -> GroundTruthReading | None:
        """Return the newest ground truth that was read; None before the first."""
        return self._connection.get_latest(GroundTruthReading)

    @property
    def status(self) -> VehicleStatus | None:
        """Return the newest status that was read; None before the first."""
        return self._connection.get_latest(VehicleStatus)

    def get_start_poses(self) -> StartPoses:
        """Return the named start poses of the world."""
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
        """Put the robot into the world; return when its first status or reading has come.

        One connection is one robot: a second spawn raises LocalProtocolError.
        """
        if any(_is_robot_report(report) for report in self._connection.latest_reports):
            raise LocalProtocolError("this connection has its robot: connect again for another")
        self._connection.send(Init(class_name, name, location_m, rotation_rad, start_pose))
        try:
            self._connection.wait_until(_is_robot_report, "a report of the robot")
        except ReplyTimeoutError as error:
            raise CatoptraError(
                f"{self._connection.peer} did not spawn {class_name!r} within "
                f"{self._connection.timeout_s:g} s. It refuses an unknown class or start in "
                "silence: check both against its configuration and its log"
            ) from error

    def drive(self, left_rad_s: float, right_rad_s: float, normalized: bool = False) -> None:
        """Set the speeds of the wheels; normalized: in percent of the fastest, -100 to 100."""
        self._connection.send(Drive(left_rad_s, right_rad_s, normalized))

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep server; return all that it reported before it was done."""
        self._connection.send(Step(time_s))
        reports = self._connection.wait_until(_is_step_result, _STEP_RESULT)
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
        """Return the next report of this type that has not been read yet."""
        return self._connection.wait_for_report(
            report_type, f"a {report_type.__name__}", timeout_s=timeout_s
        )

    def get_configuration(self, type_: str, name: str | None = None) -> Configuration:
        """Return the configuration of the `Robot`, of all sensors of a type, or of one."""
        self._connection.send(GetConf(type_, name))
        return self._connection.wait_for_report(
            Configuration,
            f"the configuration of {type_} {name or ''}",
            lambda report: _matches_type(type_, report.type) and _has_camera_name(name, report),
        )

    def get_geometry(self, type_: str, name: str | None = None) -> Geometry | VehicleGeometry:
        """Return where the sensors of a type sit, or the geometry of the `Robot` itself."""
        self._connection.send(GetGeo(type_, name))
        what = f"the geometry of {type_} {name or ''}"
        if type_.lower() == "robot":
            return self._connection.wait_for_report(VehicleGeometry, what)
        return self._connection.wait_for_report(
            Geometry, what, lambda report: _matches_type(type_, report.type)
        )

    def get_camera(self, name: str | None = None) -> OmniCamera:
        """Return the law of the omnidirectional camera: from pixels to directions and back."""
        return self.get_camera_and_height(name)[0]

    def get_camera_and_height(self, name: str | None = None) -> tuple[OmniCamera, float]:
        """Return the camera's law and the height of its viewpoint over the floor, in metres."""
        return omni_camera_from_pairs(self.get_configuration("Camera", name).pairs)


_STEP_RESULT = "the result of STEP (is it Catoptra, run with --clock lockstep?)"


def _is_robot_report(report: Report) -> bool:
    return isinstance(report, VehicleStatus | OdometryReading | GroundTruthReading)


def _is_step_result(report: Report) -> bool:
    return isinstance(report, CommandResult) and report.type.lower() == "step"


def _has_camera_name(requested_name: str | None, report: Configuration) -> bool:
    """Return whether a camera's reply is the one asked for: tiles are told unasked."""
    if requested_name is None or report.type.lower() != "camera":
        return True
    return requested_name.lower() == (report.get("Name") or "").lower()


def _matches_type(requested_type: str, reply_type: str) -> bool:
    """Return whether a reply of one type answers the other; `Robot` is answered by its kind."""
    return requested_type.lower() in (reply_type.lower(), "robot")
