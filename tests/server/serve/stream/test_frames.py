"""Frames of one client: the newest of the channel that a request selects, once, with its labels."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.labels import GroundTruth, LabelledObject
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.codec import MAX_REPLY_BYTES, pack
from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    FrameVariant,
    GetFrameRequest,
    ImageEncoding,
)
from catoptra_server.effects import EffectMode
from catoptra_server.frames.frame import IMAGE_PORT, CameraChannel, Channel, FrameLabels
from catoptra_server.frames.plan.camera import CameraVariant, ReferenceKind
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.serve.stream.frames import encode_labels, select_channel
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.stream_messages import CAMERA_MODEL
from helpers.stream_peer import connect_raw_peer


def select(robot: str, camera: str, variant: FrameVariant | None = None) -> Channel:
    return select_channel(GetFrameRequest(1, robot, camera, ImageEncoding.RAW, variant))


def test_empty_names_select_the_image_port_and_others_a_camera() -> None:
    assert select("", "") == IMAGE_PORT
    assert select("R", "") == CameraChannel("R", "")
    assert select("", "omni") == CameraChannel("", "omni")


@pytest.mark.parametrize("variant", [None, FrameVariant(samples=2)], ids=["camera", "variant"])
def test_camera_in_any_letter_case_has_one_channel(variant: FrameVariant | None) -> None:
    spellings = ("PanoCam", "panocam", "PANOCAM", "pAnOcAm")
    assert len({select("R", spelling, variant) for spelling in spellings}) == 1


def test_variant_selects_a_channel_of_its_own() -> None:
    variant = FrameVariant(
        max_error_px=0.0,
        budget_ms=5.0,
        polygons=64,
        samples=2,
        renderer="trace",
        effects={"Fog": "never"},
        reference="exact",
        picture="flipped",
    )
    expected = CameraVariant(
        max_error_px=0.0,
        budget_ms=5.0,
        polygons=64,
        samples=2,
        renderer=RendererKind.TRACE,
        effects=(("Fog", EffectMode.NEVER),),
        reference=ReferenceKind.EXACT,
        picture=Picture.FLIPPED,
    )
    assert select("", "", variant) == CameraChannel("", "", expected)


@pytest.mark.parametrize(
    "variant",
    [
        FrameVariant(polygons=5),
        FrameVariant(renderer="gpu"),
        FrameVariant(effects={"Fog": "perhaps"}),
        FrameVariant(reference="better"),
        FrameVariant(budget_ms=-1.0),
    ],
)
def test_impossible_variant_is_refused(variant: FrameVariant) -> None:
    with pytest.raises(DomainError):
        select("", "", variant)


def label_objects(count: int, name: str) -> FrameLabels:
    """Labels of an image with one pixel of each object."""
    ids = np.arange(1, count + 1, dtype=np.uint16).reshape(1, -1)
    objects = tuple(
        LabelledObject(number, name, "object", 1, Pose.identity(), np.ones(3))
        for number in range(1, count + 1)
    )
    return FrameLabels(GroundTruth({"ids": ids}, objects), has_row_times=True)


async def test_frame_without_labels_has_no_part() -> None:
    encoded = await encode_labels(None, ChannelEncoding.RAW)
    assert (encoded.record, encoded.parts) == (None, ())


async def test_record_lists_the_parts_in_their_order() -> None:
    encoded = await encode_labels(label_objects(2, "crate"), ChannelEncoding.ZLIB)
    assert encoded.record is not None
    (channel,) = encoded.record.channels
    assert (channel.name, channel.dtype, channel.depth) == ("ids", "<u2", 1)
    assert channel.num_bytes == len(encoded.parts[0])
    assert [one.number for one in encoded.record.objects] == [1, 2]
    assert encoded.record.times == "rows"


async def test_record_of_many_objects_with_long_names_fits_into_a_header() -> None:
    labels = label_objects(1500, 400 * "x")
    record = (await encode_labels(labels, ChannelEncoding.RAW)).record
    assert record is not None
    assert len(record.objects) == 1000
    assert len(pack("frame", record)) < MAX_REPLY_BYTES - 64 * 1024


async def test_frame_when_requested_has_a_complete_header() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            header, image = await peer.get_frame()
            assert image == bytes([1]) * (8 * 6 * 3)
            assert (header.robot, header.camera, header.sequence) == ("OmniP2AT", "Omni", 1)
            assert header.time_s == 0.1
            assert header.world_from_robot.position_m == (0.01, 0.0, -0.2)
            assert header.camera_model == CAMERA_MODEL
            assert header.plan == "traced"
            assert [(one.name, one.enabled) for one in header.effects] == [("Blooming", False)]
            assert header.robot_from_mirror is not None
            assert header.robot_from_mirror.position_m == (0.1, 0.0, -0.5)
            assert (header.width_px, header.height_px) == (8, 6)
            assert header.stage_ms == {"trace": 2.0}
            assert header.age_s > 0.0


@pytest.mark.parametrize("encoding", [ImageEncoding.JPEG, ImageEncoding.PNG])
async def test_frame_when_of_an_encoding_is_a_file_of_that_type(encoding: ImageEncoding) -> None:
    async with serve_fake_simulation(FakeSimulation(32, 16)) as server:
        with connect_raw_peer(server.port) as peer:
            header, image = await peer.get_frame(encoding)
            assert header.encoding is encoding
            assert image.startswith({"jpeg": b"\xff\xd8", "png": b"\x89PNG"}[encoding.value])
            bgr = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_COLOR)
            assert bgr is not None
            assert (bgr == 1).all()


async def test_request_when_repeated_has_one_reply() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            data = bytes_from_message(GetFrameRequest(9, "", "", ImageEncoding.RAW))
            await peer.send(data)
            await peer.send(data)
            assert (await peer.receive())[0].id == 9  # type: ignore[union-attr] # a header
            await peer.send(data)
            assert (await peer.get_frame())[0].sequence == 2


async def test_frames_when_rendered_for_others_are_counted_as_missed() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as slow, connect_raw_peer(server.port) as fast:
            await slow.get_frame()
            for _ in range(5):
                await fast.get_frame()
            header, _ = await slow.get_frame()
            assert (header.sequence, header.missed_frames) == (7, 5)


@pytest.mark.parametrize(("robot", "camera"), [("Other", ""), ("", "Rear")])
async def test_camera_when_missing_is_an_error_with_its_name(robot: str, camera: str) -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            reply = await peer.send_request(GetFrameRequest(1, robot, camera, ImageEncoding.RAW))
            assert isinstance(reply, Error)
            assert (robot or camera) in reply.reason


async def test_camera_when_named_and_present_is_sent() -> None:
    async with serve_fake_simulation(FakeSimulation()) as server:
        with connect_raw_peer(server.port) as peer:
            reply = await peer.send_request(
                GetFrameRequest(1, "OmniP2AT", "Omni", ImageEncoding.RAW)
            )
            assert not isinstance(reply, Error)
