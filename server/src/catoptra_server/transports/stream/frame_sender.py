"""Frames of one client: each request gets the newest frame that the client has not received.

There is no queue. Without a request nothing is rendered, encoded or stored.
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

# Channels with a recorded last frame per client, so that one that alternates between cameras gets
# no frame twice; a forgotten channel starts from any frame.
_MAX_CHANNELS = 8


class FrameSender:
    """The pending frame request of one client, if any, and its counters."""

    def __init__(
        self,
        send: SendMessage,
        mailboxes: Mailboxes,
        *,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start without a request.

        Args:
            send: Sends parts to the client.
            mailboxes: Newest frame of each channel.
            monotonic: Clock of the frame age, in seconds.
        """
        self._send = send
        self._mailboxes = mailboxes
        self._monotonic = monotonic
        self._task: asyncio.Task[None] | None = None
        self._pending: GetFrameRequest | None = None
        self._channel: Channel = IMAGE_PORT
        self._subscriptions: dict[Channel, tuple[Mailbox, int]] = {}
        self._last_id = 0
        self.num_sent = 0
        self.num_missed = 0
        self.num_dropped = 0

    @property
    def has_pending_request(self) -> bool:
        """Whether a request has no reply yet."""
        return self._pending is not None

    def submit(self, request: GetFrameRequest) -> None:
        """Serve a request.

        One with the last id changes nothing; any other replaces the pending one.
        """
        if request.id == self._last_id:
            return
        self._last_id = request.id
        self._pending = request
        channel = _select_channel(request)
        # A pending wait for another channel's frame would delay this one.
        if channel != self._channel:
            self.close()
        self._channel = channel
        # A running task serves the replaced request: one task per client at most.
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._answer_requests(channel))

    def close(self) -> None:
        """Cancel the pending request."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def _answer_requests(self, channel: Channel) -> None:
        """Reply to requests of one channel until none is pending."""
        while self._pending is not None:
            # Popped and set again after the frame: the dict's order is that of use.
            mailbox, last = self._subscriptions.pop(channel, (self._mailboxes.get(channel), 0))
            try:
                frame = await mailbox.wait_for_newer(last)
            except ChannelUnavailableError:
                request, self._pending = self._pending, None
                error = camera_not_found(request.id, request.robot, request.camera)
                self._send([bytes_from_message(error)])
                continue
            request, self._pending = self._pending, None
            # In a thread: encoding takes milliseconds, in which the loop serves other clients.
            payload = await asyncio.to_thread(frame.encode, request.encoding)
            self._remember(channel, mailbox, frame.sequence)
            self._send_frame(frame, request, payload, last=last)

    def _remember(self, channel: Channel, mailbox: Mailbox, sequence: int) -> None:
        """Record the last frame sent of a channel."""
        while len(self._subscriptions) >= _MAX_CHANNELS:
            self._subscriptions.pop(next(iter(self._subscriptions)))
        self._subscriptions[channel] = (mailbox, sequence)

    def _send_frame(
        self, frame: Frame, request: GetFrameRequest, payload: bytes, *, last: int
    ) -> None:
        if last:
            # At least 0: a robot that respawned under its old name restarts its count.
            self.num_missed += max(0, frame.sequence - last - 1)
        header = self._make_header(frame, request)
        if self._send([bytes_from_message(header), payload]) is SendResult.SENT:
            self.num_sent += 1
        else:
            self.num_dropped += 1
            # So that the client may repeat its request for the frame it did not read.
            self._last_id = 0

    def _make_header(self, frame: Frame, request: GetFrameRequest) -> FrameHeader:
        metadata, mount = frame.metadata, frame.metadata.robot_from_camera
        height_px, width_px = frame.rgb.shape[:2]
        return FrameHeader(
            version=SCHEMA_VERSION,
            id=request.id,
            robot=metadata.robot,
            class_name=metadata.class_name,
            camera=metadata.camera,
            sequence=frame.sequence,
            time_s=frame.time_s,
            world_from_robot=transform_from_pose(metadata.world_from_robot),
            robot_from_mirror=transform_from_pose(mount) if mount else None,
            camera_model=dict(metadata.camera_model) if metadata.camera_model else None,
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
    """Channel of a request: the image port, or a camera by name."""
    has_name = request.robot or request.camera
    return CameraChannel(request.robot, request.camera) if has_name else IMAGE_PORT
