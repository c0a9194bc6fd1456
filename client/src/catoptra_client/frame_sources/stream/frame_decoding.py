"""Frames of the ZeroMQ stream, decoded from the parts of a message and checked against its header.

Without socket and clock: `stream_client` receives the parts.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import Frame, LabelledPixels, Pixels, rgb_from_image_bytes
from catoptra_protocol.camera_conf import any_camera_from_pairs
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.labels import LABEL_CHANNELS, GroundTruth, LabelledObject
from catoptra_protocol.limits import MAX_IMAGE_PIXELS
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import FrameHeader
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    ChannelRecord,
    ImageEncoding,
    LabelsRecord,
    ObjectRecord,
    Transform,
)
from catoptra_protocol.usarsim.image_port import ImageType


class CameraModelCache:
    """The camera model of the last header.

    The pairs stay the same from frame to frame, and comparing them is cheaper than parsing.
    """

    def __init__(self) -> None:
        self._pairs: dict[str, str] | None = None
        self._camera: OmniCamera | PerspectiveCamera | None = None

    def get_camera(self, pairs: dict[str, str] | None) -> OmniCamera | PerspectiveCamera | None:
        """Camera model of a header's pairs; None without pairs.

        Raises:
            RemoteProtocolError: A pair is missing or wrong; names the field.
        """
        if pairs != self._pairs:
            self._camera = any_camera_from_pairs(tuple(pairs.items())) if pairs else None
            self._pairs = pairs
        return self._camera


def frame_from_parts(
    header: FrameHeader, parts: list[bytes], *, camera_cache: CameraModelCache, received_s: float
) -> Frame:
    """Decode a frame.

    Args:
        header: First part.
        parts: Parts after the header.
        camera_cache: Cache of this connection.
        received_s: Arrival time by the client's clock.

    Raises:
        RemoteProtocolError: The image does not match the header.
    """
    image, labels = _split_parts(header, parts)
    mirror, rgb = header.robot_from_mirror, _decode_rgb(header, image)
    difference_rgb = None
    if header.difference is not None:
        if header.width_px % 2:
            raise RemoteProtocolError(f"{header}: a picture and its difference have equal widths")
        rgb, difference_rgb = np.split(rgb, 2, axis=1)
    return Frame(
        rgb=rgb,
        sequence=header.sequence,
        received_s=received_s,
        # PNG is lossless, so its frames count as RAW.
        image_type=ImageType.GOOD if header.encoding is ImageEncoding.JPEG else ImageType.RAW,
        robot_name=header.robot,
        camera_name=header.camera,
        time_s=header.time_s,
        world_from_robot=pose_from_transform(header.world_from_robot),
        camera=camera_cache.get_camera(header.camera_model),
        robot_from_mirror=None if mirror is None else pose_from_transform(mirror),
        stage_ms=header.stage_ms,
        age_s=header.age_s,
        missed_frames=header.missed_frames,
        dropped_frames=header.dropped_frames,
        plan=header.plan,
        error_bound_px=header.error_bound_px,
        error_bounds=header.error_bounds,
        effects=header.effects,
        predicted_ms=header.predicted_ms,
        more_accurate=header.more_accurate,
        faster=header.faster,
        difference=header.difference,
        difference_rgb=difference_rgb,
        labels=labels,
    )


def _split_parts(header: FrameHeader, parts: list[bytes]) -> tuple[bytes, LabelledPixels | None]:
    """The image's part, and the labels in the parts behind it."""
    channels = header.labels.channels if header.labels is not None else ()
    if len(parts) != 1 + len(channels):
        raise RemoteProtocolError(
            f"{header}: {len(parts)} parts after the header, expected {1 + len(channels)}"
        )
    if header.labels is None:
        return parts[0], None
    return parts[0], _labels_from_parts(
        header.labels, parts[1:], (header.height_px, header.width_px)
    )


def _decode_rgb(header: FrameHeader, payload: bytes) -> Pixels:
    shape = (header.height_px, header.width_px, 3)
    if header.encoding is ImageEncoding.RAW:
        # An int of a header may be negative, and two negative sides have a positive product.
        if min(shape) < 0 or len(payload) != shape[0] * shape[1] * 3:
            raise RemoteProtocolError(f"{header}: its image has {len(payload)} bytes")
        # A read-only view of the received bytes: a raw frame is never copied.
        rgb: Pixels = np.frombuffer(payload, np.uint8).reshape(shape)
        return rgb
    rgb = rgb_from_image_bytes(payload)
    if rgb.shape != shape:
        raise RemoteProtocolError(f"{header}: its image has the shape {rgb.shape}")
    rgb.setflags(write=False)
    return rgb


def _labels_from_parts(
    record: LabelsRecord, parts: list[bytes], size_px: tuple[int, int]
) -> LabelledPixels:
    """Decode the labels of a frame.

    Args:
        record: Labels in the header.
        parts: One part a channel.
        size_px: Height and width of the picture.

    Raises:
        RemoteProtocolError: A part does not match its record, or a channel is unknown.
    """
    channels = {
        channel.name: _decode_channel(channel, part, size_px)
        for channel, part in zip(record.channels, parts, strict=True)
    }
    return LabelledPixels(
        GroundTruth(channels, tuple(_object_from_record(one) for one in record.objects)),
        has_row_times=record.times == "rows",
        is_displaced=record.is_displaced,
        flow_to_time_s=record.flow_to_time_s,
    )


def _decode_channel(
    record: ChannelRecord, part: bytes, size_px: tuple[int, int]
) -> npt.NDArray[Any]:
    known = LABEL_CHANNELS.get(record.name)
    if known is None or (record.dtype, record.depth) != (known.dtype, known.depth):
        raise RemoteProtocolError(f"{record}: this client knows no such channel: update it")
    height_px, width_px = size_px
    if min(size_px) < 0 or height_px * width_px > MAX_IMAGE_PIXELS:
        raise RemoteProtocolError(f"{record}: an image of {width_px} x {height_px} px")
    num_bytes = height_px * width_px * known.depth * np.dtype(known.dtype).itemsize
    data = part if record.encoding is ChannelEncoding.RAW else _inflate(record, part, num_bytes)
    if len(data) != num_bytes:
        raise RemoteProtocolError(f"{record}: {len(data)} bytes, expected {num_bytes}")
    # A read-only view of the received bytes.
    return np.frombuffer(data, known.dtype).reshape(known.shape(height_px, width_px))


def _inflate(record: ChannelRecord, part: bytes, num_bytes: int) -> bytes:
    """Decompress at most one byte more than a channel has."""
    try:
        return zlib.decompressobj().decompress(part, num_bytes + 1)
    except zlib.error as error:
        raise RemoteProtocolError(f"{record}: {error}") from error


def _object_from_record(record: ObjectRecord) -> LabelledObject:
    return LabelledObject(
        record.number,
        record.name,
        record.class_name,
        record.class_number,
        pose_from_transform(record.world_from_box),
        np.array(record.half_size_m, dtype=np.float64),
    )


def pose_from_transform(transform: Transform) -> Pose:
    """Pose of a transform in a message."""
    rotation = np.array(transform.rotation, dtype=np.float64).reshape(3, 3)
    return Pose(rotation, np.array(transform.position_m, dtype=np.float64))
