"""One subscriber's frames: it asks, and gets the newest one that it has not had. No queue.

Who asks for nothing costs nothing: nothing is drawn, encoded or kept for it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from catoptra_protocol.wire.stream import SCHEMA_VERSION, bytes_from_message
from catoptra_protocol.wire.stream_answers import FrameHeader
from catoptra_protocol.wire.stream_requests import AskFrame
from catoptra_server.imaging.frame import Frame
from catoptra_server.imaging.shot import SCREEN, CameraChannel, Channel
from catoptra_server.mailbox import Mailbox, Mailboxes, NothingShownError
from catoptra_server.transports.zmq_stream_facts import effect_records, placement
from catoptra_server.transports.zmq_stream_landmarks import nothing_shown
from catoptra_server.transports.zmq_stream_socket import Sent

Send = Callable[[list[bytes]], Sent]

# Channels whose last frame a subscriber is remembered by; one more, and the first counts anew.
_REMEMBERED_CHANNELS = 8


class FrameSlot:
    """What one subscriber asked for and has not got: one request, or none."""

    def __init__(
        self,
        send: Send,
        mailboxes: Mailboxes,
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._send = send
        self._mailboxes = mailboxes
        self._monotonic = monotonic
        self._task: asyncio.Task[None] | None = None
        self._asked: AskFrame | None = None
        self._channel: Channel = SCREEN
        self._watched: dict[Channel, tuple[Mailbox, int]] = {}  # the last sent at the end
        self._last_id = 0
        self.sent = 0
        self.missed = 0
        self.dropped = 0

    @property
    def is_waiting(self) -> bool:
        """Return whether something is asked and not sent."""
        return self._asked is not None

    def ask(self, request: AskFrame) -> None:
        """Serve a request. Repeating the last one changes nothing; a new one takes its place."""
        if request.id == self._last_id:
            return
        self._last_id = request.id
        self._asked = request
        channel = _channel(request)
        if channel != self._channel:
            self.close()
        self._channel = channel
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._serve(channel))

    def close(self) -> None:
        """Wait no longer for what was asked."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _serve(self, channel: Channel) -> None:
        """Answer what is asked of one channel, until nothing is."""
        while self._asked is not None:
            mailbox, last = self._watched.pop(channel, (self._mailboxes.of(channel), 0))
            try:
                frame = await mailbox.newer_than(last)
            except NothingShownError:
                request, self._asked = self._asked, None
                refusal = nothing_shown(request.id, request.robot, request.camera)
                self._send([bytes_from_message(refusal)])
                continue
            request, self._asked = self._asked, None
            payload = await asyncio.to_thread(frame.payload, request.encoding)
            self._watch(channel, mailbox, frame.sequence)
            self._send_frame(frame, request, payload, last=last)

    def _watch(self, channel: Channel, mailbox: Mailbox, sequence: int) -> None:
        """Remember what was sent of a channel, and of a few others: who looks about, comes back."""
        while len(self._watched) >= _REMEMBERED_CHANNELS:
            self._watched.pop(next(iter(self._watched)))
        self._watched[channel] = (mailbox, sequence)

    def _send_frame(self, frame: Frame, request: AskFrame, payload: bytes, *, last: int) -> None:
        if last:  # a robot that came anew under its old name begins to count anew
            self.missed += max(0, frame.sequence - last - 1)
        header = self._header(frame, request)
        if self._send([bytes_from_message(header), payload]) is Sent.YES:
            self.sent += 1
        else:
            self.dropped += 1
            self._last_id = 0  # it may ask again for what it did not take

    def _header(self, frame: Frame, request: AskFrame) -> FrameHeader:
        is_, mount = frame.caption, frame.caption.robot_from_camera
        height_px, width_px = frame.rgb.shape[:2]
        return FrameHeader(
            version=SCHEMA_VERSION,
            id=request.id,
            robot=is_.robot,
            class_name=is_.class_name,
            camera=is_.camera,
            sequence=frame.sequence,
            time_s=frame.time_s,
            world_from_robot=placement(is_.world_from_robot),
            robot_from_mirror=placement(mount) if mount else None,
            camera_law=dict(is_.law) if is_.law else None,
            plan=frame.plan,
            error_bound_px=frame.error_bound_px,
            stage_ms={name: float(value) for name, value in frame.stage_ms.items()},
            encoding=request.encoding,
            width_px=width_px,
            height_px=height_px,
            age_s=self._monotonic() - frame.exposed_s,
            missed=self.missed,
            dropped=self.dropped,
            bound=frame.bound,
            effects=effect_records(frame.effects, frame.stage_ms),
        )


def _channel(request: AskFrame) -> Channel:
    """Return what to draw: what the screen shows, unless somebody's camera is named."""
    named = request.robot or request.camera
    return CameraChannel(request.robot, request.camera) if named else SCREEN
