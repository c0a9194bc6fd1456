"""Decoding of header and image to a frame, and the rejection of malformed ones."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import CameraModelCache, frame_from_parts
from catoptra_protocol.camera_conf import pairs_from_omni_camera
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.stream.replies import FrameHeader
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from helpers.stream_messages import HEADER, HEADER_WITH_DIFFERENCE

CAMERA = OmniCamera(
    projection=MIRRORS["parabolic"](horizon_radius_m=0.03),
    width_px=6,
    height_px=4,
    centre_px=(3.0, 2.0),
    scale_px=1.5,
    rim_rad=1.75,
    image_up_azimuth_rad=0.0,
)
HEADER_WITH_CAMERA = dataclasses.replace(
    HEADER, camera_model=dict(pairs_from_omni_camera(CAMERA, 0.7))
)
IMAGE = np.arange(72, dtype=np.uint8).reshape(4, 6, 3)


def decode_frame(header: FrameHeader, *parts: bytes) -> Frame:
    return frame_from_parts(header, list(parts), camera_cache=CameraModelCache(), received_s=3.0)


def test_frame_when_raw_has_the_fields_of_its_header() -> None:
    frame = decode_frame(HEADER_WITH_CAMERA, IMAGE.tobytes())
    assert np.array_equal(frame.rgb, IMAGE)
    assert not frame.rgb.flags.writeable
    assert frame.camera == CAMERA
    assert frame.robot_from_mirror is not None
    assert frame.robot_from_mirror.translation.tolist() == [0.1, 0.0, -0.5]
    assert (frame.time_s, frame.age_s, frame.received_s) == (1.25, 0.03, 3.0)
    assert (frame.plan, frame.error_bound_px, frame.image_type) == ("trace", None, ImageType.RAW)
    assert [(effect.name, effect.enabled, effect.duration_ms) for effect in frame.effects] == [
        ("ShotNoise", True, 2.5)
    ]


def test_frame_when_png_is_the_same_image() -> None:
    _, data = cv2.imencode(".png", np.ascontiguousarray(IMAGE[..., ::-1]))
    frame = decode_frame(
        dataclasses.replace(HEADER_WITH_CAMERA, encoding=ImageEncoding.PNG), data.tobytes()
    )
    assert np.array_equal(frame.rgb, IMAGE)


def test_camera_when_its_pairs_stay_the_same_is_parsed_once() -> None:
    cache = CameraModelCache()
    assert cache.get_camera(HEADER_WITH_CAMERA.camera_model) is cache.get_camera(
        dict(HEADER_WITH_CAMERA.camera_model or {})
    )
    assert cache.get_camera(None) is None


BAD_MESSAGES: list[tuple[FrameHeader, tuple[bytes, ...], str]] = [
    (HEADER_WITH_CAMERA, (), "0 parts after the header"),
    (HEADER_WITH_CAMERA, (bytes(72), b""), "2 parts"),
    (HEADER_WITH_CAMERA, (bytes(71),), "71 bytes"),
    (dataclasses.replace(HEADER_WITH_CAMERA, width_px=-6, height_px=-4), (bytes(72),), "72 bytes"),
    (dataclasses.replace(HEADER_WITH_CAMERA, encoding=ImageEncoding.JPEG), (b"no file",), "JPEG"),
    (
        dataclasses.replace(HEADER_WITH_CAMERA, camera_model={"Mirror": "parabolic"}),
        (bytes(72),),
        "without",
    ),
]


@pytest.mark.parametrize(
    ("header", "parts", "expected_message"), BAD_MESSAGES, ids=lambda x: x if type(x) is str else ""
)
def test_frame_when_its_parts_disagree_is_rejected(
    header: FrameHeader, parts: tuple[bytes, ...], expected_message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=expected_message):
        decode_frame(header, *parts)


def test_image_when_of_another_size_than_its_header_is_rejected() -> None:
    _, data = cv2.imencode(".png", np.zeros((5, 6, 3), np.uint8))
    with pytest.raises(RemoteProtocolError, match=r"shape \(5, 6, 3\)"):
        decode_frame(
            dataclasses.replace(HEADER_WITH_CAMERA, encoding=ImageEncoding.PNG), data.tobytes()
        )


def test_frame_with_a_difference_has_it_apart_from_the_picture() -> None:
    header = dataclasses.replace(HEADER_WITH_CAMERA, difference=HEADER_WITH_DIFFERENCE.difference)
    frame = decode_frame(header, IMAGE.tobytes())
    assert np.array_equal(frame.rgb, IMAGE[:, :3])
    assert frame.difference_rgb is not None
    assert np.array_equal(frame.difference_rgb, IMAGE[:, 3:])
    assert frame.difference == HEADER_WITH_DIFFERENCE.difference


def test_frame_with_a_difference_of_another_width_is_refused() -> None:
    header = dataclasses.replace(HEADER_WITH_DIFFERENCE, width_px=5)
    with pytest.raises(RemoteProtocolError, match="equal widths"):
        decode_frame(header, bytes(5 * 4 * 3))
