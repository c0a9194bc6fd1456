"""Frames of one client of the stream: each request gets the newest one, once.

There is no queue: without a request nothing is rendered, encoded or stored. A request selects a
channel: the image port's picture, a camera, or a variant of one, whose settings the client states.
Labels are further parts of the frame's message, with a record in the header.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Hashable
from dataclasses import replace

from catoptra_protocol.errors import DomainError
from catoptra_protocol.labels import LABEL_CHANNELS, LabelledObject, parse_channels
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.codec import FieldMap
from catoptra_protocol.stream.messages import SCHEMA_VERSION, plain_fields_from_message
from catoptra_protocol.stream.replies import DifferenceRecord, Error, FrameHeader
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    ChannelRecord,
    GetFrameRequest,
    LabelsRecord,
    ObjectRecord,
)
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Channel,
    Frame,
    FrameLabels,
    ImageDifference,
    Payload,
    is_variant,
)
from catoptra_server.frames.mailbox import ChannelUnavailableError, Mailbox, Mailboxes
from catoptra_server.frames.plan.camera import (
    CameraVariant,
)
from catoptra_server.runtime.faults import log_fault
from catoptra_server.serve.stream.replies import (
    camera_not_found,
    plan_alternative,
    records_from_decisions,
    transform_from_pose,
)
from catoptra_server.serve.stream.router import Outbox
from catoptra_server.serve.stream.session import INTERNAL_FAULT, SendReply

log = logging.getLogger(__name__)
# A record has 300 bytes and more; a header, with all else, at most MAX_REPLY_BYTES.
_MAX_OBJECT_RECORDS = 1000
# Names come from world files and, with their nodes, from mesh files.
_MAX_NAME_CHARS = 120
# Channels with a recorded last frame per client, so that one that alternates between cameras gets
# no frame twice; a forgotten channel starts from any frame.
_MAX_CHANNELS = 8


class FrameSender:
    """The pending frame request of one client, if any, and the counters."""

    def __init__(
        self,
        outbox: Outbox,
        mailboxes: Mailboxes,
        *,
        send_reply: SendReply,
        encode: Callable[[FieldMap], bytes],
        camera_names: tuple[str, ...] | None = None,
        account: Hashable = None,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Start without a request.

        Args:
            outbox: Receives frames.
            mailboxes: Newest frame of each channel.
            send_reply: Sends an error to the client.
            encode: Encodes the fields of a frame's header.
            camera_names: Cameras of all robots, for errors; None: unknown.
            account: Pays for the frames; None: this client alone.
            monotonic: Clock of the frame age, in seconds.
        """
        self._outbox = outbox
        self._mailboxes = mailboxes
        self._send_reply = send_reply
        self._encode = encode
        self._camera_names = camera_names
        self._account = self if account is None else account
        self._monotonic = monotonic
        self._task: asyncio.Task[None] | None = None
        # A request waits for a frame, then the frame is encoded, then sent.
        self._waiting: GetFrameRequest | None = None
        self._channel: Channel = IMAGE_PORT
        self._encoding: GetFrameRequest | None = None
        self._last_sent_id = 0
        self._last_received_id = 0
        self._subscriptions: dict[Channel, tuple[Mailbox, int]] = {}
        self.num_sent = 0
        self.num_missed = 0
        self.num_dropped = 0

    @property
    def has_pending_request(self) -> bool:
        """Whether a request has no reply yet."""
        return self._waiting is not None or self._encoding is not None

    def submit(self, request: GetFrameRequest) -> None:
        """Serve a request.

        One with the last id changes nothing; any other replaces a waiting one, which gets an error.
        """
        if request.id == self._last_received_id:
            return
        self._last_received_id = request.id
        try:
            channel = self._mailboxes.resolve(select_channel(request))
        except DomainError as error:
            self._send_reply(Error(request.id, str(error)))
            return
        replaced, self._waiting = self._waiting, request
        if replaced is not None:
            self._reject_old_request(replaced.id, by=request.id)
            # A wait for another channel's frame would delay this one.
            if self._encoding is None and self._channel != channel:
                self.close()
        self._channel = channel
        # A running task serves the replaced request: one task per client at most.
        if self._task is None or self._task.done():
            self._task = asyncio.create_task(self._answer_requests())

    def close(self) -> None:
        """End the task, without a reply."""
        if self._task is not None:
            self._task.cancel()
            self._task = None

    def end(self) -> None:
        """End the task, and hold no frame any longer."""
        self.close()
        self._subscriptions.clear()

    async def _answer_requests(self) -> None:
        """Reply to requests until none waits."""
        while self._waiting is not None:
            try:
                await self._answer(self._channel)
            except Exception:
                log_fault(log, "a frame request failed")
                failed = self._encoding or self._take_waiting()
                self._encoding = None
                self._send_reply(Error(failed.id, INTERNAL_FAULT))

    async def _answer(self, channel: Channel) -> None:
        """Reply to the request that waits for a channel when a frame arrives."""
        mailbox, last = self._subscriptions.get(channel) or (self._mailboxes.get(channel), 0)
        try:
            frame = await mailbox.wait_for_newer(last, self._account)
        except ChannelUnavailableError as error:
            self._subscriptions.pop(channel, None)
            self._send_reply(self._channel_error(self._take_waiting(), error.reason))
            return
        self._encoding = request = self._take_waiting()
        payload = await frame.encode(request.encoding)
        labels = await encode_labels(frame.labels, request.channel_encoding)
        self._send_frame(frame, request, payload, labels, last=last)
        self._encoding = None
        self._remember(channel, mailbox, frame.sequence)

    def _take_waiting(self) -> GetFrameRequest:
        """Remove and return the waiting request."""
        request, self._waiting = self._waiting, None
        assert request is not None, "a request is replaced, and taken by this task alone"
        return request

    def _remember(self, channel: Channel, mailbox: Mailbox, sequence: int) -> None:
        """Record the last frame sent of a channel."""
        # The frame would be kept as long: a client may try any number of variants.
        if is_variant(channel):
            return
        # Removed and set again: the dict is in the order of use.
        self._subscriptions.pop(channel, None)
        while len(self._subscriptions) >= _MAX_CHANNELS:
            self._subscriptions.pop(next(iter(self._subscriptions)))
        self._subscriptions[channel] = (mailbox, sequence)

    def _send_frame(
        self,
        frame: Frame,
        request: GetFrameRequest,
        payload: Payload,
        labels: _EncodedLabels,
        *,
        last: int,
    ) -> None:
        if last:
            # At least 0: a robot that respawned under its old name restarts its count.
            self.num_missed += max(0, frame.sequence - last - 1)
        # One unread frame at most, the newest: a client that stalls costs no more memory.
        if self._outbox.withdraw_frame():
            self.num_sent -= 1
            self.num_dropped += 1
            self._reject_old_request(self._last_sent_id, by=request.id)
        # Once for all clients: most of a header is the same, and packing it takes time of the loop.
        if not frame.header:
            frame.header.update(plain_fields_from_message(_make_header(frame, request)))
        fields = {
            **frame.header,
            "id": request.id,
            "sequence": frame.sequence,
            "time_s": frame.time_s,
            "encoding": request.encoding.value,
            "age_s": self._monotonic() - frame.exposed_at_s,
            "missed_frames": self.num_missed,
            "dropped_frames": self.num_dropped,
            "labels": labels.record,
        }
        self._outbox.send_frame(self._encode(fields), payload, *labels.parts)
        self._last_sent_id = request.id
        self.num_sent += 1

    def _channel_error(self, request: GetFrameRequest, reason: str) -> Error:
        if reason:
            return Error(request.id, reason)
        known = self._camera_names
        return camera_not_found(request.id, request.robot, request.camera, known)

    def _reject_old_request(self, id_: int, *, by: int) -> None:
        self._send_reply(Error(id_, f"superseded by request {by}"))


def _make_header(frame: Frame, request: GetFrameRequest) -> FrameHeader:
    """Header of a frame for the client of a request that has no labels and has missed nothing."""
    metadata, mount = frame.metadata, frame.metadata.robot_from_camera
    height_px, width_px = frame.rgb.shape[:2]
    choice = frame.choice
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
        age_s=0.0,
        missed_frames=0,
        dropped_frames=0,
        error_bounds=frame.error_bounds,
        effects=records_from_decisions(frame.effect_decisions, frame.stage_ms),
        predicted_ms=choice.predicted_ms if choice else None,
        target_met=choice is None or choice.target_met,
        more_accurate=plan_alternative(choice.more_accurate) if choice else None,
        faster=plan_alternative(choice.faster) if choice else None,
        difference=_record_from_difference(frame.difference),
    )


def select_channel(request: GetFrameRequest) -> Channel:
    """Channel of a request.

    Raises:
        DomainError: The request asks for a variant that cannot be.
    """
    variant = None if request.variant is None else CameraVariant.from_request(request.variant)
    if request.channels:
        names = tuple(channel.name for channel in parse_channels(request.channels))
        variant = replace(variant or CameraVariant(), channels=names)
    if not (request.robot or request.camera or variant):
        return IMAGE_PORT
    # Robots compare the names of cameras in any case. Otherwise each spelling would be a channel of
    # its own, with a frame and a share of the time: a client that changed the spelling with every
    # request left the others 0.7 of 78 frames per second.
    return CameraChannel(request.robot, request.camera.lower(), variant)


@dataclass(frozen=True, slots=True, eq=False)
class _EncodedLabels:
    """Labels, ready to be sent."""

    record: LabelsRecord | None = None
    """None for a frame without labels."""
    parts: tuple[Payload, ...] = ()
    """Channels in the order of the record."""


async def encode_labels(labels: FrameLabels | None, encoding: ChannelEncoding) -> _EncodedLabels:
    """Encode the labels of a frame, once for all clients."""
    if labels is None:
        return _EncodedLabels()
    parts = await labels.encode(encoding)
    channels = tuple(
        ChannelRecord(
            name, LABEL_CHANNELS[name].dtype, LABEL_CHANNELS[name].depth, encoding, len(part)
        )
        for name, part in parts.items()
    )
    objects = labels.objects_in_view()[:_MAX_OBJECT_RECORDS]
    record = LabelsRecord(
        channels,
        tuple(_record_from_object(one) for one in objects),
        "rows" if labels.has_row_times else "middle",
        labels.is_displaced,
        labels.flow_to_time_s,
    )
    return _EncodedLabels(record, tuple(parts.values()))


def _record_from_object(labelled: LabelledObject) -> ObjectRecord:
    x, y, z = labelled.half_size_m.tolist()
    return ObjectRecord(
        labelled.number,
        labelled.name[:_MAX_NAME_CHARS],
        labelled.class_name[:_MAX_NAME_CHARS],
        labelled.class_number,
        transform_from_pose(labelled.world_from_box),
        (x, y, z),
    )


def _record_from_difference(difference: ImageDifference | None) -> DifferenceRecord | None:
    if difference is None:
        return None
    return DifferenceRecord(
        reference_plan=difference.reference_plan,
        max_levels=difference.max_levels,
        rms_levels=difference.rms_levels,
        changed_fraction=difference.changed_fraction,
    )
