"""Frames: channels by value, payloads encoded once, labels, differences."""

from __future__ import annotations

import asyncio
import math
import zlib

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.labels import GroundTruth, LabelledObject
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.requests import ChannelEncoding, ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.frames import frame as encode_module
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Frame,
    FrameLabels,
    ImagePortChannel,
    append_difference,
    is_variant,
)
from catoptra_server.frames.plan.camera import CameraVariant


def make_frame(rgb: npt.NDArray[np.uint8]) -> Frame:
    return Frame(1, 0.0, rgb, 0.0, 0.0)


def make_image(height: int, width: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)


@pytest.mark.parametrize("encoding", [ImageType.RAW, ImageType.BAD], ids=lambda e: e.name)
async def test_image_when_requested_by_several_clients_is_encoded_once(
    encoding: ImageType, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[ImageType] = []

    def encode(rgb: npt.NDArray[np.uint8], encoding: ImageType) -> bytes:
        calls.append(encoding)
        return b"encoded"

    monkeypatch.setattr(encode_module, "encode_image", encode)
    frame = make_frame(make_image(4, 4))
    encoded = await asyncio.gather(*[frame.encode(encoding) for _ in range(8)])
    assert encoded == [b"encoded"] * 8
    assert await frame.encode(encoding) is encoded[0]
    assert calls == [encoding]


async def test_client_that_leaves_while_an_image_is_encoded_leaves_the_others_waiting() -> None:
    frame = make_frame(make_image(4, 4))
    gone, stays = (asyncio.create_task(frame.encode(ImageType.GOOD)) for _ in range(2))
    await asyncio.sleep(0)
    gone.cancel()
    assert len(await stays) > 0


async def test_jpeg_when_requested_by_both_transports_is_encoded_once() -> None:
    frame = make_frame(make_image(8, 8))
    payload, reply = [await frame.encode(e) for e in (ImageEncoding.JPEG, ImageType.GOOD)]
    assert isinstance(payload, memoryview)
    assert payload.obj is reply
    assert bytes(payload) == reply[-len(payload) :]


async def test_png_and_raw_of_the_stream_when_decoded_are_the_image() -> None:
    rgb = make_image(6, 5)
    frame = make_frame(rgb)
    png = cv2.imdecode(
        np.frombuffer(await frame.encode(ImageEncoding.PNG), np.uint8), cv2.IMREAD_COLOR_RGB
    )
    np.testing.assert_array_equal(png, rgb)
    raw = np.frombuffer(await frame.encode(ImageEncoding.RAW), np.uint8).reshape(rgb.shape)
    np.testing.assert_array_equal(raw, rgb)


def test_difference_is_absolute_and_to_the_right_of_the_picture() -> None:
    rgb = np.array([[[10, 0, 255], [5, 5, 5]]], dtype=np.uint8)
    reference = np.array([[[0, 255, 255], [5, 5, 5]]], dtype=np.uint8)
    image, difference = append_difference(rgb, reference, "exact")
    assert image[:, :2].tolist() == rgb.tolist()
    assert image[:, 2:].tolist() == [[[10, 255, 0], [0, 0, 0]]]
    assert (difference.reference_plan, difference.max_levels) == ("exact", 255)
    assert difference.rms_levels == pytest.approx(math.sqrt((10**2 + 255**2) / 6))
    assert difference.changed_fraction == 0.5
    assert not image.flags.writeable


def test_equal_images_do_not_differ() -> None:
    rgb = np.full((2, 3, 3), 7, dtype=np.uint8)
    _, difference = append_difference(rgb, rgb, "")
    numbers = (difference.max_levels, difference.rms_levels, difference.changed_fraction)
    assert numbers == (0, 0.0, 0.0)


def test_channels_are_equal_by_value() -> None:
    assert ImagePortChannel() == IMAGE_PORT
    first, second = (CameraChannel("R", "", CameraVariant(samples=1)) for _ in range(2))
    assert len({first, second, CameraChannel("R", "")}) == 2


def test_variant_is_a_camera_by_other_settings() -> None:
    assert is_variant(CameraChannel("R", "Omni", CameraVariant()))
    assert not is_variant(CameraChannel("R", "Omni"))
    assert not is_variant(IMAGE_PORT)


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


async def test_payloads_are_encoded_once() -> None:
    for encoding in ChannelEncoding:
        first = await LABELS.encode(encoding)
        assert await LABELS.encode(encoding) is first
    raw, packed = [await LABELS.encode(encoding) for encoding in ChannelEncoding]
    assert bytes(raw["ids"]) == IDS.tobytes() == zlib.decompress(packed["ids"])
    assert bytes(raw["flow"]) == FLOW.tobytes()
