"""Labels of a frame: the other hand, objects in view, payloads."""

from __future__ import annotations

import asyncio
import zlib

import numpy as np

from catoptra_protocol.labels.channels import GroundTruth, LabelledObject
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.requests import ChannelEncoding
from catoptra_server.frames.frame import FrameLabels

IDS = np.array(((0, 2, 2), (0, 0, 5)), dtype=np.uint16)
FLOW = np.arange(12, dtype=np.float32).reshape(2, 3, 2)
OBJECTS = tuple(
    LabelledObject(number, f"o{number}", "object", 1, Pose.identity(), np.ones(3))
    for number in range(1, 6)
)
LABELS = FrameLabels(GroundTruth({"ids": IDS, "flow": FLOW}, OBJECTS), flow_to_time_s=0.5)


def test_turned_labels_are_those_of_the_turned_picture() -> None:
    turned = LABELS.turn().truth.channels
    np.testing.assert_array_equal(turned["ids"], ((2, 2, 0), (5, 0, 0)))
    # A displacement to the right leads to the left in the other hand.
    np.testing.assert_array_equal(turned["flow"][0, 0], (-4.0, 5.0))
    np.testing.assert_array_equal(FLOW[0, 2], (4.0, 5.0))


def test_objects_in_view_are_those_of_the_ids() -> None:
    assert [one.number for one in LABELS.objects_in_view()] == [2, 5]
    assert FrameLabels(GroundTruth({}, OBJECTS)).objects_in_view() == ()


def test_payloads_are_encoded_once() -> None:
    async def encode_twice() -> None:
        for encoding in ChannelEncoding:
            first = await LABELS.encode(encoding)
            assert await LABELS.encode(encoding) is first
        raw, packed = [await LABELS.encode(encoding) for encoding in ChannelEncoding]
        assert bytes(raw["ids"]) == IDS.tobytes() == zlib.decompress(packed["ids"])
        assert bytes(raw["flow"]) == FLOW.tobytes()

    asyncio.run(encode_twice())
