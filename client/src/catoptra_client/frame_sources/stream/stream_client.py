"""The modern stream: one connection for robot and frames, over ZeroMQ.

Blocking, for one thread. Frames are pulled: each is the newest at the moment it is asked for, so a
program that is slow misses frames and never sees old ones. The connection is made anew by itself
after the server was away; the robot is then gone and has to be spawned again.
"""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self, TypeVar

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.frame_decoding import CameraModelCache, frame_from_parts
from catoptra_client.frame_sources.stream.landmark_projections import (
    LandmarkProjection,
    landmarks_from_reply,
    projections_from_reply,
)
from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    DeadlineExceededError,
    RemoteProtocolError,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import (
    CameraReply,
    Error,
    FrameHeader,
    LandmarksReply,
    Ok,
    PlanReply,
    Reply,
    SensorReports,
    StartPoseRecord,
    StartPosesReply,
    StatusReply,
)
from catoptra_protocol.stream.requests import (
    DriveRequest,
    GetCameraRequest,
    GetFrameRequest,
    GetLandmarksRequest,
    GetReadingsRequest,
    GetStartPosesRequest,
    GetStatusRequest,
    ImageEncoding,
    Request,
    ResetRequest,
    SetAccuracyRequest,
    SpawnRequest,
    StepRequest,
)
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.reports import Report, report_from_message
from catoptra_protocol.vectors import Vector3

_LOG = logging.getLogger(__name__)
# A request for a frame is repeated, with its id, in case a server that restarted lost it.
_RETRY_INTERVAL_S = 1.0

_ReplyT = TypeVar("_ReplyT", bound=Reply)
_Parts = list[bytes]


class StreamClient:
    """One client of a stream server, from `connect` to `close`; also a context manager.

    Waiting calls raise ConnectionLostError if nothing is heard of the server, DeadlineExceededError if it
    lives but does not answer within `timeout_s`, and CatoptraError with its reason if it refuses.
    Each may be repeated: the connection comes back by itself.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        timeout_s: float = 5.0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to connect. `clock` gives `Frame.received_s` and measures the timeouts."""
        self._socket = StreamSocket(host, port, clock=clock)
        self._timeout_s = timeout_s
        self._clock = clock
        self._ids = itertools.count(1)
        self._camera_cache = CameraModelCache()

    @classmethod
    def connect(cls, host: str = "127.0.0.1", port: int = 5005, timeout_s: float = 5.0) -> Self:
        """Return a client that the server has answered once."""
        client = cls(host, port, timeout_s=timeout_s)
        try:
            client.get_status()
        except BaseException:
            client.close()
            raise
        return client

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

    def get_status(self) -> StatusReply:
        """Return what the server is and does."""
        return self._call(GetStatusRequest(next(self._ids)), StatusReply)

    def spawn(
        self,
        class_name: str,
        *,
        name: str | None = None,
        location_m: Vector3 | None = None,
        rotation_rad: Vector3 = (0.0, 0.0, 0.0),
        start_pose: str | None = None,
    ) -> list[Report]:
        """Put this client's robot into the world; return its first readings."""
        id_ = next(self._ids)
        request = SpawnRequest(id_, class_name, name, location_m, rotation_rad, start_pose)
        return _parse_reports(self._call(request, SensorReports))

    def drive(self, left: float | None, right: float | None, *, normalized: bool = False) -> None:
        """Set the wheel speeds, rad/s or percent; None leaves a side as it is."""
        self._call(DriveRequest(next(self._ids), left, right, normalized), Ok)

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep clock; return the whole cycle of readings and the result."""
        return _parse_reports(self._call(StepRequest(next(self._ids), time_s), SensorReports))

    def reset(self) -> None:
        """Take the robot out of the world; another may be spawned."""
        self._call(ResetRequest(next(self._ids)), Ok)

    def get_readings(self) -> list[Report]:
        """Return the newest reading of each sensor of the robot."""
        return _parse_reports(self._call(GetReadingsRequest(next(self._ids)), SensorReports))

    def get_camera(self, name: str = "") -> OmniCamera:
        """Return the law of a camera: from pixels to directions and back."""
        return self.get_camera_and_height(name)[0]

    def get_camera_and_height(self, name: str = "") -> tuple[OmniCamera, float]:
        """Return a camera's law and the height of its viewpoint over the floor, in metres."""
        answer = self._call(GetCameraRequest(next(self._ids), name), CameraReply)
        return omni_camera_from_pairs(tuple(answer.camera_model.items()))

    def set_accuracy(
        self,
        *,
        max_error_px: float | None = None,
        budget_ms: float | None = None,
        camera: str = "",
    ) -> PlanReply:
        """Return how the robot's camera is drawn, after asking for another accuracy or time.

        None leaves one as it is, 0 asks for it no more. The first time the server may measure what
        frames cost, which takes seconds.
        """
        return self._call(
            SetAccuracyRequest(next(self._ids), camera, max_error_px, budget_ms), PlanReply
        )

    def get_landmarks(self) -> tuple[Landmark, ...]:
        """Return where the world's landmarks truly are."""
        return landmarks_from_reply(
            self._call(GetLandmarksRequest(next(self._ids)), LandmarksReply)
        )

    def get_landmark_projections(
        self, robot: str = "", camera: str = ""
    ) -> tuple[LandmarkProjection, ...]:
        """Return what a camera sees of the landmarks now; names as for `frame`."""
        return projections_from_reply(
            self._call(GetLandmarksRequest(next(self._ids), robot, camera), LandmarksReply)
        )

    def get_start_poses(self) -> tuple[StartPoseRecord, ...]:
        """Return the named start poses of the world."""
        return self._call(GetStartPosesRequest(next(self._ids)), StartPosesReply).start_poses

    def get_frame(
        self, *, encoding: ImageEncoding = ImageEncoding.JPEG, robot: str = "", camera: str = ""
    ) -> Frame:
        """Return the newest frame, of a camera by name or of the one that is shown."""
        request = GetFrameRequest(next(self._ids), robot, camera, encoding)
        header, parts = self._exchange(
            request, FrameHeader, "a frame", retry_interval_s=_RETRY_INTERVAL_S
        )
        return frame_from_parts(
            header, parts, camera_cache=self._camera_cache, received_s=self._clock()
        )

    def iter_frames(
        self, *, encoding: ImageEncoding = ImageEncoding.JPEG, robot: str = "", camera: str = ""
    ) -> Iterator[Frame]:
        """Iterate over newest frames for ever; a frame is asked for when it is wanted."""
        while True:
            yield self.get_frame(encoding=encoding, robot=robot, camera=camera)

    def _call(self, request: Request, reply_type: type[_ReplyT]) -> _ReplyT:
        return self._exchange(request, reply_type, f"an answer to {request.KIND}")[0]

    def _exchange(
        self,
        request: Request,
        reply_type: type[_ReplyT],
        description: str,
        retry_interval_s: float | None = None,
    ) -> tuple[_ReplyT, _Parts]:
        """Send a request; return its answer and the parts behind it."""
        data = bytes_from_message(request)
        deadline_s = self._clock() + self._timeout_s
        while True:
            _LOG.debug("to %s: %s", self._socket.address, request)
            self._socket.send(data, deadline_s)
            until_s = deadline_s if retry_interval_s is None else self._clock() + retry_interval_s
            answer = self._wait_for_reply(request.id, min(until_s, deadline_s))
            if answer is not None:
                return self._check_reply(answer[0], reply_type), answer[1]
            if self._clock() >= deadline_s:
                raise self._timeout_error(description)

    def _wait_for_reply(self, id_: int, deadline_s: float) -> tuple[Reply, _Parts] | None:
        """Return the answer with an id; what else comes is older or a pulse."""
        while (parts := self._socket.receive(deadline_s)) is not None:
            answer = reply_from_bytes(parts[0])
            _LOG.debug("from %s: %s", self._socket.address, answer)
            if isinstance(answer, Error) and answer.id == 0:
                raise RemoteProtocolError(f"{self._socket.address} cannot read us: {answer.reason}")
            if answer is not None and getattr(answer, "id", None) == id_:
                return answer, parts[1:]
        return None

    def _check_reply(self, reply: Reply, reply_type: type[_ReplyT]) -> _ReplyT:
        if isinstance(reply, Error):
            raise CatoptraError(f"{self._socket.address} refused: {reply.reason}")
        if not isinstance(reply, reply_type):
            raise RemoteProtocolError(f"{self._socket.address} answered with {reply.KIND}")
        return reply

    def _timeout_error(self, description: str) -> CatoptraError:
        """Return the error that tells a lost server from a slow one."""
        if self._socket.is_lost():
            return ConnectionLostError(
                f"lost the stream server at {self._socket.address}: nothing heard of it. Its log "
                "tells why; call again once it is back, and spawn again"
            )
        return DeadlineExceededError(
            f"{self._socket.address} lives but did not send {description} within {self._timeout_s:g} s: "
            "it is busy drawing or stepping; wait, or take a larger timeout_s"
        )


def _parse_reports(reply: SensorReports) -> list[Report]:
    found = (report_from_message(parse_message(line)) for line in reply.reports)
    return [report for report in found if report is not None]
