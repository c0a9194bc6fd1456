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
from catoptra_client.stream_frame import CameraLaws, frame_from_parts
from catoptra_client.stream_landmarks import (
    SeenLandmark,
    landmarks_from_answer,
    seen_from_answer,
)
from catoptra_client.stream_socket import StreamSocket
from catoptra_protocol.camera_conf import camera_from_pairs
from catoptra_protocol.errors import (
    CatoptraError,
    ConnectionLostError,
    RemoteProtocolError,
    ServerSlowError,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.wire.grammar import parse_message
from catoptra_protocol.wire.numbers import Vector
from catoptra_protocol.wire.reports import Report, report_from_message
from catoptra_protocol.wire.stream import answer_from_bytes, bytes_from_message
from catoptra_protocol.wire.stream_answers import (
    Answer,
    CameraIs,
    Done,
    FrameHeader,
    LandmarksAre,
    PlanIs,
    Refused,
    Reported,
    StartRecord,
    StartsAre,
    StatusIs,
)
from catoptra_protocol.wire.stream_requests import (
    AskCamera,
    AskDrive,
    AskFrame,
    AskLandmarks,
    AskPlan,
    AskReadings,
    AskReset,
    AskSpawn,
    AskStarts,
    AskStatus,
    AskStep,
    Encoding,
    Request,
)

_LOG = logging.getLogger(__name__)
# A request for a frame is repeated, with its id, in case a server that restarted lost it.
_REPEAT_S = 1.0

_A = TypeVar("_A", bound=Answer)
_Parts = list[bytes]


class StreamClient:
    """One client of a stream server, from `connect` to `close`; also a context manager.

    Waiting calls raise ConnectionLostError if nothing is heard of the server, ServerSlowError if it
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
        self._laws = CameraLaws()

    @classmethod
    def connect(cls, host: str = "127.0.0.1", port: int = 5005, timeout_s: float = 5.0) -> Self:
        """Return a client that the server has answered once."""
        client = cls(host, port, timeout_s=timeout_s)
        try:
            client.status()
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

    def status(self) -> StatusIs:
        """Return what the server is and does."""
        return self._ask(AskStatus(next(self._ids)), StatusIs)

    def spawn(
        self,
        class_name: str,
        *,
        name: str | None = None,
        location_m: Vector | None = None,
        rotation_rad: Vector = (0.0, 0.0, 0.0),
        start: str | None = None,
    ) -> list[Report]:
        """Put this client's robot into the world; return its first readings."""
        id_ = next(self._ids)
        request = AskSpawn(id_, class_name, name, location_m, rotation_rad, start)
        return _reports(self._ask(request, Reported))

    def drive(self, left: float | None, right: float | None, *, normalized: bool = False) -> None:
        """Set the wheel speeds, rad/s or percent; None leaves a side as it is."""
        self._ask(AskDrive(next(self._ids), left, right, normalized), Done)

    def step(self, time_s: float) -> list[Report]:
        """Advance a lockstep clock; return the whole cycle of readings and the result."""
        return _reports(self._ask(AskStep(next(self._ids), time_s), Reported))

    def reset(self) -> None:
        """Take the robot out of the world; another may be spawned."""
        self._ask(AskReset(next(self._ids)), Done)

    def readings(self) -> list[Report]:
        """Return the newest reading of each sensor of the robot."""
        return _reports(self._ask(AskReadings(next(self._ids)), Reported))

    def camera(self, name: str = "") -> OmniCamera:
        """Return the law of a camera: from pixels to directions and back."""
        return self.camera_and_height(name)[0]

    def camera_and_height(self, name: str = "") -> tuple[OmniCamera, float]:
        """Return a camera's law and the height of its viewpoint over the floor, in metres."""
        answer = self._ask(AskCamera(next(self._ids), name), CameraIs)
        return camera_from_pairs(tuple(answer.camera_law.items()))

    def plan(
        self,
        *,
        max_error_px: float | None = None,
        budget_ms: float | None = None,
        camera: str = "",
    ) -> PlanIs:
        """Return how the robot's camera is drawn, after asking for another accuracy or time.

        None leaves one as it is, 0 asks for it no more. The first time the server may measure what
        frames cost, which takes seconds.
        """
        return self._ask(AskPlan(next(self._ids), camera, max_error_px, budget_ms), PlanIs)

    def landmarks(self) -> tuple[Landmark, ...]:
        """Return where the world's landmarks truly are."""
        return landmarks_from_answer(self._ask(AskLandmarks(next(self._ids)), LandmarksAre))

    def landmarks_seen(self, robot: str = "", camera: str = "") -> tuple[SeenLandmark, ...]:
        """Return what a camera sees of the landmarks now; names as for `frame`."""
        return seen_from_answer(
            self._ask(AskLandmarks(next(self._ids), robot, camera), LandmarksAre)
        )

    def start_poses(self) -> tuple[StartRecord, ...]:
        """Return the named start poses of the world."""
        return self._ask(AskStarts(next(self._ids)), StartsAre).starts

    def frame(
        self, *, encoding: Encoding = Encoding.JPEG, robot: str = "", camera: str = ""
    ) -> Frame:
        """Return the newest frame, of a camera by name or of the one that is shown."""
        request = AskFrame(next(self._ids), robot, camera, encoding)
        header, parts = self._answer(request, FrameHeader, "a frame", repeat_s=_REPEAT_S)
        return frame_from_parts(header, parts, laws=self._laws, received_s=self._clock())

    def frames(
        self, *, encoding: Encoding = Encoding.JPEG, robot: str = "", camera: str = ""
    ) -> Iterator[Frame]:
        """Iterate over newest frames for ever; a frame is asked for when it is wanted."""
        while True:
            yield self.frame(encoding=encoding, robot=robot, camera=camera)

    def _ask(self, request: Request, form: type[_A]) -> _A:
        return self._answer(request, form, f"an answer to {request.KIND}")[0]

    def _answer(
        self, request: Request, form: type[_A], what: str, repeat_s: float | None = None
    ) -> tuple[_A, _Parts]:
        """Send a request; return its answer and the parts behind it."""
        data = bytes_from_message(request)
        deadline_s = self._clock() + self._timeout_s
        while True:
            _LOG.debug("to %s: %s", self._socket.address, request)
            self._socket.send(data, deadline_s)
            until_s = deadline_s if repeat_s is None else self._clock() + repeat_s
            answer = self._wait(request.id, min(until_s, deadline_s))
            if answer is not None:
                return self._checked(answer[0], form), answer[1]
            if self._clock() >= deadline_s:
                raise self._silent(what)

    def _wait(self, id_: int, until_s: float) -> tuple[Answer, _Parts] | None:
        """Return the answer with an id; what else comes is older or a pulse."""
        while (parts := self._socket.receive(until_s)) is not None:
            answer = answer_from_bytes(parts[0])
            _LOG.debug("from %s: %s", self._socket.address, answer)
            if isinstance(answer, Refused) and answer.id == 0:
                raise RemoteProtocolError(f"{self._socket.address} cannot read us: {answer.reason}")
            if answer is not None and getattr(answer, "id", None) == id_:
                return answer, parts[1:]
        return None

    def _checked(self, answer: Answer, form: type[_A]) -> _A:
        if isinstance(answer, Refused):
            raise CatoptraError(f"{self._socket.address} refused: {answer.reason}")
        if not isinstance(answer, form):
            raise RemoteProtocolError(f"{self._socket.address} answered with {answer.KIND}")
        return answer

    def _silent(self, what: str) -> CatoptraError:
        """Return the error that tells a lost server from a slow one."""
        if self._socket.is_lost():
            return ConnectionLostError(
                f"lost the stream server at {self._socket.address}: nothing heard of it. Its log "
                "tells why; call again once it is back, and spawn again"
            )
        return ServerSlowError(
            f"{self._socket.address} lives but did not send {what} within {self._timeout_s:g} s: "
            "it is busy drawing or stepping; wait, or take a larger timeout_s"
        )


def _reports(answer: Reported) -> list[Report]:
    found = (report_from_message(parse_message(line)) for line in answer.reports)
    return [report for report in found if report is not None]
