"""A robot on a Catoptra or USARSim server: spawn it, drive it, read its sensors, over TCP.

Blocking, one connection = one robot, for one thread. Nothing is read between calls: each call reads
until it has what it asked for, and on its way keeps the newest reading of every sensor. This is a
thin shell around the sans-I/O `ControlClient`.
"""

from __future__ import annotations

import logging
import socket
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType
from typing import Self, TypeVar

from catoptra_client.tcp import connected, peer_address
from catoptra_protocol.camera_conf import camera_from_pairs
from catoptra_protocol.errors import CatoptraError, ConnectionLostError, LocalProtocolError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.wire.commands import (
    Command,
    Drive,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    Step,
)
from catoptra_protocol.wire.connection import ControlClient
from catoptra_protocol.wire.numbers import Vector
from catoptra_protocol.wire.reports import (
    Configuration,
    Geometry,
    Greeting,
    GroundTruthReading,
    OdometryReading,
    Report,
    Result,
    StartPoses,
    VehicleGeometry,
    VehicleStatus,
)

_LOG = logging.getLogger(__name__)
_READ_BYTES = 64 * 1024

_R = TypeVar("_R", bound=Report)


class Robot:
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
        self._socket = connection
        self._peer = peer_address(connection)
        self._timeout_s = timeout_s
        self._clock = clock
        self._protocol = ControlClient()
        self._unread: deque[Report] = deque()
        self._latest: dict[type[object], Report] = {}

    @classmethod
    def connect(cls, host: str = "127.0.0.1", port: int = 3000, timeout_s: float = 5.0) -> Self:
        """Return a robot still to be spawned, once the server has greeted."""
        robot = cls(connected(host, port, timeout_s, server="control"), timeout_s=timeout_s)
        try:
            robot._wait(Greeting, "a greeting (is this the control port?)")
        except CatoptraError:
            robot.close()
            raise
        return robot

    def close(self) -> None:
        """End the connection: the server removes the robot."""
        self._socket.close()

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
        return self._newest(Greeting)

    @property
    def odometry(self) -> OdometryReading | None:
        """Return the newest odometry that was read; None before the first."""
        return self._newest(OdometryReading)

    @property
    def ground_truth(self) -> GroundTruthReading | None:
        """Return the newest ground truth that was read; None before the first."""
        return self._newest(GroundTruthReading)

    @property
    def status(self) -> VehicleStatus | None:
        """Return the newest status that was read; None before the first."""
        return self._newest(VehicleStatus)

    def start_poses(self) -> StartPoses:
        """Return the named start poses of the world."""
        self._send(GetStartPoses())
        return self._wait(StartPoses, "the start poses")

    def spawn(
        self,
        class_name: str,
        *,
        name: str | None = None,
        location_m: Vector | None = None,
        rotation_rad: Vector = (0.0, 0.0, 0.0),
        start: str | None = None,
    ) -> None:
        """Put the robot into the world; return when its first status or reading has come.

        One connection is one robot: a second spawn raises LocalProtocolError.
        """
        if any(_is_of_a_robot(report) for report in self._latest.values()):
            raise LocalProtocolError("this connection has its robot: connect again for another")
        self._send(Init(class_name, name, location_m, rotation_rad, start))
        try:
            self._wait_until(_is_of_a_robot, self._timeout_s, "a report of the robot")
        except _SilentError as error:
            raise CatoptraError(
                f"{self._peer} did not spawn {class_name!r} within {self._timeout_s:g} s. It "
                "refuses an unknown class or start in silence: check both against its "
                "configuration and its log"
            ) from error

    def drive(self, left_rad_s: float, right_rad_s: float, normalized: bool = False) -> None:
        """Set the speeds of the wheels; normalized: in percent of the fastest, -100 to 100."""
        self._send(Drive(left_rad_s, right_rad_s, normalized))

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep server; return all that it reported before it was done."""
        self._send(Step(time_s))
        reports = self._wait_until(_is_step_result, self._timeout_s, _STEP_DONE)
        result = reports.pop()
        if isinstance(result, Result) and result.status != "OK":
            raise CatoptraError(
                f"{self._peer} did not step by {time_s:g} s (status {result.status}): "
                "run the server with --clock lockstep, and step by at most a minute"
            )
        return reports

    def wait_for(self, report_type: type[_R], timeout_s: float | None = None) -> _R:
        """Return the next report of this type that has not been read yet."""
        return self._wait(report_type, f"a {report_type.__name__}", timeout_s=timeout_s)

    def configuration(self, type_: str, name: str | None = None) -> Configuration:
        """Return the configuration of the `Robot`, of all sensors of a type, or of one."""
        self._send(GetConf(type_, name))
        return self._wait(
            Configuration,
            f"the configuration of {type_} {name or ''}",
            lambda report: _answers(type_, report.type),
        )

    def geometry(self, type_: str, name: str | None = None) -> Geometry | VehicleGeometry:
        """Return where the sensors of a type sit, or the geometry of the `Robot` itself."""
        self._send(GetGeo(type_, name))
        what = f"the geometry of {type_} {name or ''}"
        if type_.lower() == "robot":
            return self._wait(VehicleGeometry, what)
        return self._wait(Geometry, what, lambda report: _answers(type_, report.type))

    def camera(self, name: str | None = None) -> OmniCamera:
        """Return the law of the omnidirectional camera: from pixels to directions and back."""
        return self.camera_and_height(name)[0]

    def camera_and_height(self, name: str | None = None) -> tuple[OmniCamera, float]:
        """Return the camera's law and the height of its viewpoint over the floor, in metres."""
        return camera_from_pairs(self.configuration("Camera", name).pairs)

    def _newest(self, report_type: type[_R]) -> _R | None:
        report = self._latest.get(report_type)
        return report if isinstance(report, report_type) else None

    def _send(self, command: Command) -> None:
        _LOG.debug("to %s: %s", self._peer, command)
        try:
            self._socket.sendall(self._protocol.send(command))
        except OSError as error:
            raise self._lost(str(error)) from error

    def _wait(
        self,
        report_type: type[_R],
        what: str,
        accepts: Callable[[_R], bool] = lambda report: True,
        timeout_s: float | None = None,
    ) -> _R:
        """Return the next report of a type that is accepted."""

        def wanted(report: Report) -> bool:
            return isinstance(report, report_type) and accepts(report)

        limit_s = self._timeout_s if timeout_s is None else timeout_s
        found = self._wait_until(wanted, limit_s, what)[-1]
        assert isinstance(found, report_type)
        return found

    def _wait_until(
        self, wanted: Callable[[Report], bool], timeout_s: float, what: str
    ) -> list[Report]:
        """Return the reports up to the first wanted one, which is the last of them."""
        deadline_s = self._clock() + timeout_s
        reports: list[Report] = []
        while True:
            while not self._unread:
                self._unread.extend(self._read(deadline_s, what))
            reports.append(self._unread.popleft())
            if wanted(reports[-1]):
                return reports

    def _read(self, deadline_s: float, what: str) -> list[Report]:
        """Return what the next bytes say, having noted it as the newest of its kind."""
        # Without bytes: what the last ones held behind a malformed report, if there was one.
        reports = self._protocol.receive(b"") or self._protocol.receive(
            self._bytes(deadline_s, what)
        )
        for report in reports:
            _LOG.debug("from %s: %s", self._peer, report)
            self._latest[type(report)] = report
        return reports

    def _bytes(self, deadline_s: float, what: str) -> bytes:
        """Return some bytes of the server; an error tells what was waited for."""
        try:
            data = self._bytes_before(deadline_s)
        except TimeoutError as error:
            raise _SilentError(f"{self._peer} is connected but did not send {what}") from error
        except OSError as error:
            raise self._lost(str(error)) from error
        if not data:
            raise self._lost("it closed the connection")
        return data

    def _bytes_before(self, deadline_s: float) -> bytes:
        left_s = deadline_s - self._clock()
        if left_s <= 0.0:  # other reports can stream in for ever
            raise TimeoutError
        self._socket.settimeout(left_s)
        return self._socket.recv(_READ_BYTES)

    def _lost(self, reason: str) -> ConnectionLostError:
        return ConnectionLostError(
            f"lost the control server at {self._peer}: {reason}. Its log tells why; "
            "connect and spawn again to go on"
        )


class _SilentError(ConnectionLostError):
    """The server is there but did not send what was asked for in time."""


_STEP_DONE = "the result of STEP (is it Catoptra, run with --clock lockstep?)"


def _is_of_a_robot(report: Report) -> bool:
    return isinstance(report, VehicleStatus | OdometryReading | GroundTruthReading)


def _is_step_result(report: Report) -> bool:
    return isinstance(report, Result) and report.type.lower() == "step"


def _answers(asked: str, answered: str) -> bool:
    """Return whether a reply of one type answers the other; `Robot` is answered by its kind."""
    return asked.lower() in (answered.lower(), "robot")
