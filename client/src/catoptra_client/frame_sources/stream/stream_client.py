"""Client of the ZeroMQ stream: one connection for robot and frames.

Blocking, for one thread. Frames are pulled: each is the newest at the moment of its request, so a
slow program misses frames and never gets old ones. After the server was down the connection is made
anew by itself; the robot is then gone and has to be spawned again.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Self

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.frame_decoding import (
    CameraModelCache,
    frame_from_parts,
)
from catoptra_client.frame_sources.stream.label_decoding import pose_from_transform
from catoptra_client.frame_sources.stream.landmark_projections import (
    LandmarkProjection,
    landmarks_from_reply,
    projections_from_reply,
)
from catoptra_client.frame_sources.stream.request_exchange import RequestExchange
from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.camera_conf import (
    Pairs,
    any_camera_from_pairs,
    omni_camera_from_pairs,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.notes import text_from_note
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import (
    CameraReply,
    LandmarksReply,
    Ok,
    PixelReply,
    PlanReply,
    SensorReports,
    StartPoseRecord,
    StartPosesReply,
    StateReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    DriveRequest,
    FrameVariant,
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetPixelRequest,
    GetReadingsRequest,
    GetStartPosesRequest,
    GetStateRequest,
    GetStatusRequest,
    ImageEncoding,
    PublishRequest,
    ResetRequest,
    SetAccuracyRequest,
    ShareControlRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.reports import Report, report_from_message
from catoptra_protocol.vectors import Vector3


class StreamClient:
    """One client of a stream server, from `connect` to `close`; also a context manager.

    Waiting calls raise ConnectionLostError if the server sends nothing for 1.5 s,
    DeadlineExceededError if it sends heartbeats but no reply within `timeout_s`, and CatoptraError
    with the server's reason if the request is rejected. Each call may be repeated: the connection
    is restored by itself.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start to connect.

        Args:
            host: Host name or address.
            port: TCP port of the stream.
            timeout_s: Timeout of each call.
            clock: Clock of the timeouts and of `Frame.received_s`, in seconds.
        """
        self._exchange = RequestExchange(
            StreamSocket(host, port, clock=clock), timeout_s=timeout_s, clock=clock
        )
        self._clock = clock
        # From 1: 0 is the id of errors about unreadable messages.
        self._ids = itertools.count(1)
        # One per connection: frames of one camera mostly follow each other.
        self._camera_cache = CameraModelCache()

    @classmethod
    def connect(cls, host: str = "127.0.0.1", port: int = 5005, timeout_s: float = 5.0) -> Self:
        """Connect and wait for the first reply of the server.

        Raises:
            ConnectionLostError: No server at this address.
        """
        client = cls(host, port, timeout_s=timeout_s)
        try:
            # ZeroMQ connects in the background: only a reply proves that there is a server.
            client.get_status()
        # KeyboardInterrupt included: an open socket would keep its I/O thread alive.
        except BaseException:
            client.close()
            raise
        return client

    def close(self) -> None:
        """End the connection: the server removes the robot."""
        self._exchange.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def get_status(self) -> StatusReply:
        """Identity and state of the server."""
        return self._exchange.call(GetStatusRequest(next(self._ids)), StatusReply)

    def spawn(
        self,
        class_name: str,
        *,
        name: str | None = None,
        location_m: Vector3 | None = None,
        rotation_rad: Vector3 = (0.0, 0.0, 0.0),
        start_pose: str | None = None,
    ) -> list[Report]:
        """Spawn this client's robot; its first readings.

        Args:
            class_name: Class of the robot, one of `get_status().class_names`.
            name: Requested name; None lets the server choose.
            location_m: Position in the world frame; takes precedence over the start pose.
            rotation_rad: Roll, pitch, yaw in the world frame, with a location.
            start_pose: Name of a start pose.
        """
        # Arguments by keyword and defaults as in INIT; the message has every field.
        id_ = next(self._ids)
        request = SpawnRequest(id_, class_name, name, location_m, start_pose, rotation_rad)
        return _parse_reports(self._exchange.call(request, SensorReports))

    def drive(
        self,
        left: float | None,
        right: float | None,
        *,
        normalized: bool = False,
        robot: str = "",
    ) -> None:
        """Set the wheel speeds of both sides.

        Args:
            left: Speed in rad/s, or in percent if normalized; None leaves the side unchanged.
            right: As `left`.
            normalized: Whether speeds are percent of the maximum.
            robot: Exact name of a robot whose owner shares its control; empty = this client's own.
        """
        self._exchange.call(DriveRequest(next(self._ids), left, right, normalized, robot), Ok)

    def share_control(self, shared: bool = True) -> None:
        """Let other clients drive this client's robot, or no longer; it halts then."""
        self._exchange.call(ShareControlRequest(next(self._ids), shared), Ok)

    def publish(self, name: str, note: Mapping[str, object]) -> None:
        """Publish a note about the robot, such as the belief of its localization, to all viewers.

        A note replaces the one of the same name.

        Args:
            name: Name of the note, at most 64 printable characters.
            note: Values of JSON, numbers and arrays of NumPy; SPEC.md 9.7 lists the keys that
                viewers draw.

        Raises:
            LocalProtocolError: The note has more than 8 KiB of JSON, or a number that is not
                finite.
        """
        self._exchange.call(PublishRequest(next(self._ids), name, text_from_note(name, note)), Ok)

    def get_state(self, robot: str = "") -> StateReply:
        """Poses of all robots, and the newest readings and notes of one.

        Args:
            robot: Exact name; empty = the robot that the image port displays.
        """
        return self._exchange.call(GetStateRequest(next(self._ids), robot), StateReply)

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep clock; the full cycle of readings and the result."""
        return _parse_reports(
            self._exchange.call(StepRequest(next(self._ids), time_s), SensorReports)
        )

    def reset(self) -> None:
        """Remove the robot from the world; another one may be spawned."""
        self._exchange.call(ResetRequest(next(self._ids)), Ok)

    def get_readings(self) -> list[Report]:
        """Newest reading of each sensor of the robot."""
        return _parse_reports(
            self._exchange.call(GetReadingsRequest(next(self._ids)), SensorReports)
        )

    def get_camera(self, name: str = "") -> OmniCamera | PerspectiveCamera:
        """Model of a camera of either kind: projection of directions to pixels, and back.

        Args:
            name: Name in any case; empty = the first camera of this client's robot, or without a
                robot that of the first class with a camera.
        """
        return self.get_mounted_camera(name)[1]

    def get_camera_and_height(self, name: str = "") -> tuple[OmniCamera, float]:
        """Model of an omnidirectional camera, and the viewpoint's height above the floor in metres.

        Args:
            name: As in `get_camera`.

        Raises:
            RemoteProtocolError: The camera is a perspective one.
        """
        return omni_camera_from_pairs(_pairs_of(self._request_camera(name)))

    def get_mounted_camera(
        self, name: str = ""
    ) -> tuple[str, OmniCamera | PerspectiveCamera, Pose]:
        """Name and model of a camera, and the pose of its viewpoint on the robot.

        Args:
            name: As in `get_camera`.
        """
        reply = self._request_camera(name)
        model = any_camera_from_pairs(_pairs_of(reply))
        return reply.camera, model, pose_from_transform(reply.robot_from_mirror)

    def _request_camera(self, name: str) -> CameraReply:
        return self._exchange.call(GetCameraRequest(next(self._ids), name), CameraReply)

    def set_accuracy(
        self,
        *,
        max_error_px: float | None = None,
        budget_ms: float | None = None,
        camera: str = "",
    ) -> PlanReply:
        """Set the accuracy target of an omnidirectional camera; the resulting rendering plan.

        Without arguments the call only reads the plan. At the first target the server may measure
        the cost of frames, which takes seconds.

        Args:
            max_error_px: Bound on the displacement of outlines; 0 = none, None = unchanged.
            budget_ms: Duration of a frame; 0 = none, None = unchanged.
            camera: Name; empty = the omnidirectional camera of the robot.
        """
        return self._exchange.call(
            SetAccuracyRequest(next(self._ids), camera, max_error_px, budget_ms), PlanReply
        )

    def get_landmarks(self) -> tuple[Landmark, ...]:
        """True landmarks of the world."""
        return landmarks_from_reply(
            self._exchange.call(GetLandmarksRequest(next(self._ids)), LandmarksReply)
        )

    def get_landmark_projections(
        self, robot: str = "", camera: str = ""
    ) -> tuple[LandmarkProjection, ...]:
        """Projections of the landmarks into a camera now; names as in `get_frame`."""
        return projections_from_reply(
            self._exchange.call(GetLandmarksRequest(next(self._ids), robot, camera), LandmarksReply)
        )

    def get_start_poses(self) -> tuple[StartPoseRecord, ...]:
        """Named start poses of the world."""
        return self._exchange.call(
            GetStartPosesRequest(next(self._ids)), StartPosesReply
        ).start_poses

    def get_frame(
        self,
        *,
        encoding: ImageEncoding = ImageEncoding.JPEG,
        robot: str = "",
        camera: str = "",
        variant: FrameVariant | None = None,
        channels: Sequence[str] = (),
        channel_encoding: ChannelEncoding = ChannelEncoding.RAW,
    ) -> Frame:
        """Request the newest frame and wait.

        Args:
            encoding: Encoding of the image; PNG and RAW are lossless.
            robot: Name of the robot; with an empty `camera` too, the image-port picture.
            camera: Name of the camera; empty = the first one of the robot.
            variant: Other settings for this frame, of an omnidirectional camera; the camera's own
                stay as they are.
            channels: Names of channels of ground truth (`catoptra_protocol.labels.channels`), of
                one camera of any kind; the frame's `labels` has them.
            channel_encoding: Raw values, or compressed by zlib.
        """
        request = GetFrameRequest(
            next(self._ids), robot, camera, encoding, variant, tuple(channels), channel_encoding
        )
        header, parts = self._exchange.request_frame(request)
        return frame_from_parts(
            header, parts, camera_cache=self._camera_cache, received_s=self._clock()
        )

    def get_pixel(
        self, u_px: float, v_px: float, *, robot: str = "", camera: str = ""
    ) -> PixelReply:
        """What a camera sees at a point of its image now; names as in `get_frame`."""
        return self._exchange.call(
            GetPixelRequest(next(self._ids), robot, camera, u_px, v_px), PixelReply
        )

    def iter_frames(
        self, *, encoding: ImageEncoding = ImageEncoding.JPEG, robot: str = "", camera: str = ""
    ) -> Iterator[Frame]:
        """Iterate over newest frames for ever; each is requested when the iterator advances."""
        while True:
            yield self.get_frame(encoding=encoding, robot=robot, camera=camera)


def _pairs_of(reply: CameraReply) -> Pairs:
    return tuple(reply.camera_model.items())


def _parse_reports(reply: SensorReports) -> list[Report]:
    reports = (report_from_message(parse_message(line)) for line in reply.reports)
    # None is a report of a newer server, which this client skips.
    return [report for report in reports if report is not None]
