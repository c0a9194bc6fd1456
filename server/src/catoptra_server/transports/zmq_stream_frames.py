"""One subscriber's frames: it asks, and gets the newest one that it has not had. No queue.

Who asks for nothing costs nothing: nothing is drawn, encoded or kept for it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping

from catoptra_protocol.wire.stream import SCHEMA_VERSION, bytes_from_message
from catoptra_protocol.wire.stream_answers import FrameHeader, Refused
from catoptra_protocol.wire.stream_requests import AskFrame
from catoptra_server.encode import Frame
from catoptra_server.mailbox import Mailbox
from catoptra_server.transports.zmq_stream_facts import CameraFacts, CameraKey, placement
from catoptra_server.transports.zmq_stream_socket import Sent

Send = Callable[[list[bytes]], Sent]


class FrameSlot:
    """What one subscriber asked for and has not got: one request, or none."""

    def __init__(
        self,
        send: Send,
        mailbox: Mailbox,
        cameras: Mapping[CameraKey, CameraFacts],
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._send = send
        self._mailbox = mailbox
        self._cameras = cameras
        self._monotonic = monotonic
        self._task: asyncio.Task[None] | None = None
        self._asked: AskFrame | None = None
        self._last_id = 0
        self._last_sequence = 0
        self.sent = 0
        self.missed = 0
        self.dropped = 0

    def ask(self, request: AskFrame) -> None:
        """Serve a request. Repeating the last one changes nothing; a new one takes its place."""
        if request.id == self._last_id:
            return
        self._last_id = request.id
        self._asked = request
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._serve())

    def close(self) -> None:
        """Forget what was asked."""
        if self._task is not None:
            self._task.cancel()

    async def _serve(self) -> None:
        while self._asked is not None:
            frame = await self._mailbox.newer_than(self._last_sequence)
            request, self._asked = self._asked, None
            if request.robot not in ("", frame.robot) or request.camera not in ("", frame.camera):
                self._send([bytes_from_message(_other_camera(request, frame))])
                continue
            payload = await asyncio.to_thread(frame.payload, request.encoding)
            self._send_frame(frame, request, payload)

    def _send_frame(self, frame: Frame, request: AskFrame, payload: bytes) -> None:
        if self._last_sequence:
            self.missed += frame.sequence - self._last_sequence - 1
        self._last_sequence = frame.sequence
        header = self._header(frame, request)
        if self._send([bytes_from_message(header), payload]) is Sent.YES:
            self.sent += 1
        else:
            self.dropped += 1
            self._last_id = 0  # it may ask again for what it did not take

    def _header(self, frame: Frame, request: AskFrame) -> FrameHeader:
        facts = self._cameras.get((frame.class_name, frame.camera))
        height_px, width_px = frame.rgb.shape[:2]
        return FrameHeader(
            version=SCHEMA_VERSION,
            id=request.id,
            robot=frame.robot,
            class_name=frame.class_name,
            camera=frame.camera,
            sequence=frame.sequence,
            time_s=frame.time_s,
            world_from_robot=placement(frame.world_from_robot),
            robot_from_mirror=placement(facts.robot_from_mirror) if facts else None,
            camera_law=dict(facts.law) if facts else None,
            plan=frame.plan or (facts.plan if facts else None),
            error_bound_px=frame.error_bound_px,
            stage_ms={name: float(value) for name, value in frame.stage_ms.items()},
            encoding=request.encoding,
            width_px=width_px,
            height_px=height_px,
            age_s=self._monotonic() - (frame.finished_s - frame.drawn_s),
            missed=self.missed,
            dropped=self.dropped,
        )


def _other_camera(request: AskFrame, frame: Frame) -> Refused:
    shown = f"{frame.camera!r} of robot {frame.robot!r}" if frame.robot else "none: no robot"
    return Refused(
        request.id,
        f"no camera {request.camera!r} of robot {request.robot!r} is shown; shown is {shown}",
    )
