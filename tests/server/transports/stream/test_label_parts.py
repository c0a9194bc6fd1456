"""Labels as parts of a message, and their record."""

from __future__ import annotations

import asyncio

import numpy as np

from catoptra_protocol.labels.channels import GroundTruth, LabelledObject
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.codec import MAX_REPLY_BYTES, pack
from catoptra_protocol.stream.requests import ChannelEncoding
from catoptra_server.frames.frame import FrameLabels
from catoptra_server.serve.stream.frames import MAX_OBJECT_RECORDS, encode_labels


def label_objects(count: int, name: str) -> FrameLabels:
    """Labels of an image with one pixel of each object."""
    ids = np.arange(1, count + 1, dtype=np.uint16).reshape(1, -1)
    objects = tuple(
        LabelledObject(number, name, "object", 1, Pose.identity(), np.ones(3))
        for number in range(1, count + 1)
    )
    return FrameLabels(GroundTruth({"ids": ids}, objects), has_row_times=True)


def test_frame_without_labels_has_no_part() -> None:
    encoded = asyncio.run(encode_labels(None, ChannelEncoding.RAW))
    assert (encoded.record, encoded.parts) == (None, ())


def test_record_lists_the_parts_in_their_order() -> None:
    encoded = asyncio.run(encode_labels(label_objects(2, "crate"), ChannelEncoding.ZLIB))
    assert encoded.record is not None
    (channel,) = encoded.record.channels
    assert (channel.name, channel.dtype, channel.depth) == ("ids", "<u2", 1)
    assert channel.num_bytes == len(encoded.parts[0])
    assert [one.number for one in encoded.record.objects] == [1, 2]
    assert encoded.record.times == "rows"


def test_record_of_many_objects_with_long_names_fits_into_a_header() -> None:
    labels = label_objects(MAX_OBJECT_RECORDS + 500, 400 * "x")
    record = asyncio.run(encode_labels(labels, ChannelEncoding.RAW)).record
    assert record is not None
    assert len(record.objects) == MAX_OBJECT_RECORDS
    assert len(pack("frame", record)) < MAX_REPLY_BYTES - 64 * 1024
