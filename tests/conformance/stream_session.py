"""One connection to a stream with a robot, for the checks of this port.

The library's client reads and validates every message; what a check observes is its meaning.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.frame_decoding import pose_from_transform
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    DeadlineExceededError,
    RemoteProtocolError,
)
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import Reply, SensorReports
from catoptra_protocol.stream.requests import ImageEncoding, Request, SpawnRequest
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.value_format import vector_from_text
from catoptra_protocol.vectors import Vector3
from conformance.check import CheckFailed, CheckSkipped, ServerUnderTest
from conformance.control_readings import PlanarPose, wrap

_ReplyT = TypeVar("_ReplyT", bound=Reply)

# Ten times a slow server's reply, on a busy machine.
REPLY_TIMEOUT_S = 30.0
# Longest duration of a turn, less than half a revolution, and of the halt after it.
_TURN_TIMEOUT_S = 1.0
# Percent of the maximum: half a radian in a few reports of each sensor.
_TURN_PERCENT = 50.0
# A robot that moves less than this in this time stands.
_STANDING_M, _STANDING_RAD, _STANDING_S = 1e-3, 1e-3, 0.03
# Frames that are ready before a request; a client has one request pending.
_MAX_OLD_FRAMES = 5


@dataclass(frozen=True, slots=True)
class StreamRobot:
    """A robot with a camera, and the connection that owns it."""

    client: StreamClient
    name: str
    clock: Callable[[], float]

    def get_frame(self, encoding: ImageEncoding = ImageEncoding.RAW) -> Frame:
        """New frame of the robot's first camera."""
        return self.client.get_frame(encoding=encoding, robot=self.name)

    def get_frame_after(self, time_s: float) -> Frame:
        """First frame that was exposed after a time; the server may have an older one ready.

        Raises:
            CheckFailed: No frame of this time came.
        """
        deadline_s = self.clock() + REPLY_TIMEOUT_S
        times: list[float] = []
        while self.clock() < deadline_s and len(times) < _MAX_OLD_FRAMES:
            frame = self.get_frame()
            times.append(frame.time_s or 0.0)
            if times[-1] >= time_s:
                return frame
        raise CheckFailed(
            f"{len(times)} frames requested after the time {time_s:.3f} s have time_s up to "
            f"{max(times):.3f}"
        )

    def turn_right(self, turn_rad: float) -> float:
        """Turn on the place by an angle or for a time, and stand; the time when it stands."""
        start = self.planar_pose_in_state()
        self.client.drive(
            _TURN_PERCENT, -_TURN_PERCENT, normalized=True, halt_after_s=2.0 * _TURN_TIMEOUT_S
        )
        deadline_s = self.clock() + _TURN_TIMEOUT_S
        while self.clock() < deadline_s:
            if abs(wrap(self.planar_pose_in_state().yaw_rad - start.yaw_rad)) >= turn_rad:
                break
        self.client.drive(0.0, 0.0)
        return self.wait_until_standing()

    def wait_until_standing(self) -> float:
        """Wait until the robot moves no more; the time of the state then."""
        deadline_s = self.clock() + _TURN_TIMEOUT_S
        last_s, last = self.read_state()
        while self.clock() < deadline_s:
            time_s, pose = self.read_state()
            if time_s >= last_s + _STANDING_S:
                motion = last.motion_to(pose)
                if motion.distance_m < _STANDING_M and abs(motion.yaw_rad) < _STANDING_RAD:
                    break
                last_s, last = time_s, pose
        return time_s

    def read_time_s(self) -> float:
        """Simulation time by `get_state`."""
        return self.read_state()[0]

    def planar_pose_in_state(self) -> PlanarPose:
        """True pose of the robot by `get_state`."""
        return self.read_state()[1]

    def read_state(self) -> tuple[float, PlanarPose]:
        """Simulation time and true pose of the robot at that time, by `get_state`."""
        state = self.client.get_state(self.name)
        for robot in state.robots:
            if robot.name == self.name:
                return state.time_s, planar_pose(pose_from_transform(robot.world_from_robot))
        raise CheckFailed(f"the state does not list the robot {self.name}")


def ask(
    client: StreamClient, request: Callable[..., Request], reply: type[_ReplyT], *values: object
) -> _ReplyT:
    """Reply to a request with these fields, as the server sent it."""
    return client._call(request, reply, *values)


def require(observed: object, expected: object, name: str) -> None:
    """Fail where two values differ."""
    if observed != expected:
        raise CheckFailed(f"{name}: {observed!r:.300}, expected {expected!r:.300}")


@contextmanager
def connect_stream(server: ServerUnderTest) -> Iterator[StreamClient]:
    """Connect to the stream for the length of a block."""
    host, port = server.addresses["stream"]
    with StreamClient(host, port, timeout_s=REPLY_TIMEOUT_S, clock=server.clock) as client:
        if server.replace_socket is not None:
            client._socket = server.replace_socket(client._socket)
        client.get_status()
        yield client


@contextmanager
def spawn_on_stream(
    server: ServerUnderTest, location_m: Vector3 | None = None, yaw_rad: float = 0.0
) -> Iterator[StreamRobot]:
    """Spawn a robot with a camera for the length of a block.

    Args:
        server: Server.
        location_m: Place in the world frame; None: the server's spawn pose.
        yaw_rad: Heading at this place.

    Raises:
        CheckSkipped: The class has no camera.
    """
    with connect_stream(server) as client:
        name = _spawn(client, server, location_m, yaw_rad)
        if name not in [one.name for one in client.get_state().robots]:
            raise CheckFailed(
                f"the robot {name!r} of {server.robot_class} was spawned, but the state has none"
            )
        robot = StreamRobot(client, name, server.clock)
        try:
            robot.get_frame()
        except (RemoteProtocolError, ConnectionLostError, DeadlineExceededError):
            raise
        # What is left is an error reply: the conversations fail where it is none about the camera.
        except CatoptraError as error:
            raise CheckSkipped(f"{server.robot_class} has no camera: {error}") from error
        yield robot


def _spawn(
    client: StreamClient, server: ServerUnderTest, location_m: Vector3 | None, yaw_rad: float
) -> str:
    """Name of a robot at a place, or at the pose of the server's blocks of INIT."""
    rotation_rad, start = (0.0, 0.0, yaw_rad), None
    if location_m is None:
        blocks = parse_message(f"INIT {server.spawn_pose}")
        location, rotation = blocks.get("Location"), blocks.get("Rotation")
        location_m = None if location is None else vector_from_text(location)
        rotation_rad = (0.0, 0.0, 0.0) if rotation is None else vector_from_text(rotation)
        start = blocks.get("Start")
    fields = server.robot_class, None, location_m, start, rotation_rad
    return ask(client, SpawnRequest, SensorReports, *fields).robot


def pose_of(frame: Frame) -> Pose:
    """Pose of the robot in a frame of the stream.

    Raises:
        CheckFailed: The frame has none.
    """
    if frame.world_from_robot is None:
        raise CheckFailed(f"frame {frame.sequence} has no world_from_robot")
    return frame.world_from_robot


def planar_pose(pose: Pose) -> PlanarPose:
    """Place and heading of a pose."""
    x, y, _ = map(float, pose.translation)
    return PlanarPose(x, y, math.atan2(float(pose.rotation[1, 0]), float(pose.rotation[0, 0])))


def camera_of(frame: Frame) -> OmniCamera | PerspectiveCamera:
    """Camera model in a frame of one camera.

    Raises:
        CheckFailed: The frame has none.
    """
    if frame.camera is None:
        raise CheckFailed(f"frame {frame.sequence} of one camera has no camera model")
    return frame.camera
