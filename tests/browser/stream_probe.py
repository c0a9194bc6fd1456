"""A blocking stream client that observes a server while a page uses it."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import zmq

from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import (
    Error,
    FrameHeader,
    Heartbeat,
    Ok,
    Reply,
    RobotState,
    SensorReports,
    StateReply,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetFrameRequest,
    GetStateRequest,
    ImageEncoding,
    PublishRequest,
    Request,
    ResetRequest,
    ShareControlRequest,
    SpawnRequest,
    StepRequest,
)

_LIMIT_S = 20.0
_ReplyT = TypeVar("_ReplyT", bound=Reply)


class StreamProbe:
    """One connection to the stream."""

    def __init__(self, socket: zmq.Socket[bytes]) -> None:
        self._socket = socket
        self._ids = itertools.count(1)

    def spawn(self, name: str, x_m: float, y_m: float, class_name: str = "USARBot.OmniP2AT") -> str:
        """Spawn a robot; its name."""
        request = SpawnRequest(next(self._ids), class_name, name, (x_m, y_m, 0.0), None)
        return self._call(request, SensorReports)[0].robot

    def reset(self) -> None:
        """Remove the own robot."""
        self._call(ResetRequest(next(self._ids)), Ok)

    def drive(self, left_rad_s: float, right_rad_s: float) -> None:
        """Set the wheel speeds of the own robot."""
        self._call(DriveRequest(next(self._ids), left_rad_s, right_rad_s, False), Ok)

    def share_control(self, shared: bool) -> None:
        """Let other clients drive the own robot, or no longer."""
        self._call(ShareControlRequest(next(self._ids), shared), Ok)

    def publish(self, name: str, text: str) -> None:
        """Publish a note about the own robot."""
        self._call(PublishRequest(next(self._ids), name, text), Ok)

    def step(self, time_s: float) -> None:
        """Advance a lockstep clock."""
        self._call(StepRequest(next(self._ids), time_s), SensorReports)

    def get_state(self, robot: str = "") -> StateReply:
        """Poses and speeds of all robots, notes of one."""
        return self._call(GetStateRequest(next(self._ids), robot), StateReply)[0]

    def get_robot(self, name: str) -> RobotState | None:
        """State of one robot; None without one of that name."""
        return next((robot for robot in self.get_state().robots if robot.name == name), None)

    def get_png(self, robot: str, camera: str = "") -> tuple[FrameHeader, bytes]:
        """Newest frame of a camera, lossless."""
        request = GetFrameRequest(next(self._ids), robot, camera, ImageEncoding.PNG)
        header, parts = self._call(request, FrameHeader)
        return header, parts[0]

    def measure_clock_offset(self, num_polls: int = 200) -> float:
        """Seconds between the system's clock and simulation time.

        The clock advances in ticks: the smallest difference is that of the poll right after one.
        """
        return min(
            -self.get_state().time_s + time.time()  # the subtrahend first: it takes the time
            for _ in range(num_polls)
        )

    def _call(self, request: Request, reply_type: type[_ReplyT]) -> tuple[_ReplyT, list[bytes]]:
        self._socket.send(bytes_from_message(request))
        end_s = time.monotonic() + _LIMIT_S
        while time.monotonic() < end_s:
            head, *rest = self._socket.recv_multipart()
            reply = reply_from_bytes(head)
            if reply is None or isinstance(reply, Heartbeat) or reply.id != request.id:
                continue
            assert not isinstance(reply, Error), f"{request} was rejected: {reply.reason}"
            assert isinstance(reply, reply_type), f"{request} has the reply {reply}"
            return reply, rest
        raise AssertionError(f"no reply to {request} within {_LIMIT_S:g} s")


@contextmanager
def connect_probe(port: int) -> Iterator[StreamProbe]:
    """Connect to the stream of a server on this machine."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    try:
        socket = context.socket(zmq.DEALER)
        socket.set(zmq.RCVTIMEO, int(1000 * _LIMIT_S))
        socket.connect(f"tcp://127.0.0.1:{port}")
        yield StreamProbe(socket)
    finally:
        context.destroy(linger=0)
