"""Decoding of the labels of a stream frame, with checks before memory is allocated."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import LabelledPixels
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.labels.channels import LABEL_CHANNELS, GroundTruth, LabelledObject
from catoptra_protocol.limits import MAX_IMAGE_PIXELS
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    ChannelRecord,
    LabelsRecord,
    ObjectRecord,
    Transform,
)


def labels_from_parts(
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


def pose_from_transform(transform: Transform) -> Pose:
    """Pose of a transform in a message."""
    rotation = np.array(transform.rotation, dtype=np.float64).reshape(3, 3)
    return Pose(rotation, np.array(transform.position_m, dtype=np.float64))


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
