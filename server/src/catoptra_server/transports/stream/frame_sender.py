"""One subscriber's frames: it asks, and gets the newest one that it has not had. No queue.

Who asks for nothing costs nothing: nothing is drawn, encoded or kept for it.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from catoptra_protocol.stream.messages import SCHEMA_VERSION, bytes_from_message
from catoptra_protocol.stream.replies import FrameHeader
from catoptra_protocol.stream.requests import GetFrameRequest
from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_request import IMAGE_PORT, CameraChannel, Channel
from catoptra_server.frames.mailbox import ChannelUnavailableError, Mailbox, Mailboxes
from catoptra_server.transports.stream.landmark_replies import camera_not_found
from catoptra_server.transports.stream.router_socket import SendResult
from catoptra_server.transports.stream.server_info import (
    records_from_decisions,
    transform_from_pose,
)

SendMessage = Callable[[list[bytes]], SendResult]

# Channels whose last frame a subscriber is remembered by; one more, and the first counts anew.
_MAX_CHANNELS = 8


class FrameSender:
    """What one subscriber asked for and has not got: one request, or none."""

    def __init__(
        self,
        send: SendMessage,
        mailboxes: Mailboxes,
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._send = send
        self._mailboxes = mailboxes
        self._monotonic = monotonic
        self._task: asyncio.Task[None] | None = None
        self._pending: GetFrameRequest | None = None
        self._channel: Channel = IMAGE_PORT
        self._subscriptions: dict[Channel, tuple[Mailbox, int]] = {}  # the last sent at the end
        self._last_id = 0
        self.num_sent = 0
        self.num_missed = 0
        self.num_dropped = 0

    @property
    def has_pending_request(self) -> bool:
        """Return whether something is asked and not sent."""
        return self._pending is not None

    def submit(self, request: GetFrameRequest) -> None:
        """Serve a request. Repeating the last one changes nothing; a new one takes its place."""
        if request.id == self._last_id:
            return
        self._last_id = request.id
        self._pending = request
        channel = _select_channel(request)
        if channel != self._channel:
            self.close()
        self._channel = channel
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._answer_requests(channel))

    def close(self) -> None:
        """Wait no longer for what was asked."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _answer_requests(self, channel: Channel) -> None:
        """Answer what is asked of one channel, until nothing is."""
        while self._pending is not None:
            mailbox, last = self._subscriptions.pop(channel, (self._mailboxes.get(channel), 0))
            try:
                frame = await mailbox.wait_for_newer(last)
            except ChannelUnavailableError:
                request, self._pending = self._pending, None
                refusal = camera_not_found(request.id, request.robot, request.camera)
                self._send([bytes_from_message(refusal)])
                continue
            request, self._pending = self._pending, None
            payload = await asyncio.to_thread(frame.encode, request.encoding)
            self._remember(channel, mailbox, frame.sequence)
            self._send_frame(frame, request, payload, last=last)

    def _remember(self, channel: Channel, mailbox: Mailbox, sequence: int) -> None:
        """Remember what was sent of a channel, and of a few others: who looks about, comes back."""
        while len(self._subscriptions) >= _MAX_CHANNELS:
            self._subscriptions.pop(next(iter(self._subscriptions)))
        self._subscriptions[channel] = (mailbox, sequence)

    def _send_frame(
        self, frame: Frame, request: GetFrameRequest, payload: bytes, *, last: int
    ) -> None:
        if last:  # a robot that came anew under its old name begins to count anew
            self.num_missed += max(0, frame.sequence - last - 1)
        header = self._make_header(frame, request)
        if self._send([bytes_from_message(header), payload]) is SendResult.SENT:
            self.num_sent += 1
        else:
            self.num_dropped += 1
            self._last_id = 0  # it may ask again for what it did not take

    def _make_header(self, frame: Frame, request: GetFrameRequest) -> FrameHeader:
        is_, mount = frame.metadata, frame.metadata.robot_from_camera
        height_px, width_px = frame.rgb.shape[:2]
        return FrameHeader(
            version=SCHEMA_VERSION,
            id=request.id,
            robot=is_.robot,
            class_name=is_.class_name,
            camera=is_.camera,
            sequence=frame.sequence,
            time_s=frame.time_s,
            world_from_robot=transform_from_pose(is_.world_from_robot),
            robot_from_mirror=transform_from_pose(mount) if mount else None,
            camera_model=dict(is_.camera_model) if is_.camera_model else None,
            plan=frame.plan,
            error_bound_px=frame.error_bound_px,
            stage_ms={name: float(value) for name, value in frame.stage_ms.items()},
            encoding=request.encoding,
            width_px=width_px,
            height_px=height_px,
            age_s=self._monotonic() - frame.exposed_at_s,
            missed_frames=self.num_missed,
            dropped_frames=self.num_dropped,
            error_bounds=frame.error_bounds,
            effects=records_from_decisions(frame.effect_decisions, frame.stage_ms),
        )


def _select_channel(request: GetFrameRequest) -> Channel:
    """Return what to draw: what the screen shows, unless somebody's camera is named."""
    named = request.robot or request.camera
    return CameraChannel(request.robot, request.camera) if named else IMAGE_PORT
