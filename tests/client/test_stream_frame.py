"""From header and picture to a frame, and what is refused."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from catoptra_client.frame import Frame
from catoptra_client.stream_frame import CameraLaws, frame_from_parts
from catoptra_protocol.camera_conf import pairs_from_camera
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.wire.image import ImageType
from catoptra_protocol.wire.stream_answers import FrameHeader
from catoptra_protocol.wire.stream_requests import Encoding
from helpers.stream_messages import HEADER

CAMERA = OmniCamera(
    mirror=MIRRORS["parabolic"](horizon_radius_m=0.03),
    width_px=6,
    height_px=4,
    centre_px=(3.0, 2.0),
    horizon_radius_px=1.5,
    rim_rad=1.75,
    up_azimuth_rad=0.0,
)
LAWFUL = dataclasses.replace(HEADER, camera_law=dict(pairs_from_camera(CAMERA, 0.7)))
PICTURE = np.arange(72, dtype=np.uint8).reshape(4, 6, 3)


def frame_of(header: FrameHeader, *parts: bytes) -> Frame:
    return frame_from_parts(header, list(parts), laws=CameraLaws(), received_s=3.0)


def test_frame_when_raw_holds_what_the_header_says() -> None:
    frame = frame_of(LAWFUL, PICTURE.tobytes())
    assert np.array_equal(frame.rgb, PICTURE)
    assert not frame.rgb.flags.writeable
    assert frame.camera == CAMERA
    assert frame.robot_from_mirror is not None
    assert frame.robot_from_mirror.translation.tolist() == [0.1, 0.0, -0.5]
    assert (frame.time_s, frame.age_s, frame.received_s) == (1.25, 0.03, 3.0)
    assert (frame.plan, frame.error_bound_px, frame.image_type) == ("trace", None, ImageType.RAW)
    assert [(effect.name, effect.is_on, effect.ms) for effect in frame.effects] == [
        ("ShotNoise", True, 2.5)
    ]


def test_frame_when_png_is_the_same_picture() -> None:
    _, data = cv2.imencode(".png", np.ascontiguousarray(PICTURE[..., ::-1]))
    frame = frame_of(dataclasses.replace(LAWFUL, encoding=Encoding.PNG), data.tobytes())
    assert np.array_equal(frame.rgb, PICTURE)


def test_law_when_it_stays_the_same_is_read_once() -> None:
    laws = CameraLaws()
    assert laws.camera(LAWFUL.camera_law) is laws.camera(dict(LAWFUL.camera_law or {}))
    assert laws.camera(None) is None


BAD: list[tuple[FrameHeader, tuple[bytes, ...], str]] = [
    (LAWFUL, (), "0 parts behind the header"),
    (LAWFUL, (bytes(72), b""), "2 parts"),
    (LAWFUL, (bytes(71),), "71 bytes"),
    (dataclasses.replace(LAWFUL, width_px=-6, height_px=-4), (bytes(72),), "72 bytes"),
    (dataclasses.replace(LAWFUL, encoding=Encoding.JPEG), (b"no file",), "JPEG"),
    (dataclasses.replace(LAWFUL, camera_law={"Mirror": "parabolic"}), (bytes(72),), "without"),
]


@pytest.mark.parametrize(
    ("header", "parts", "said"), BAD, ids=lambda x: x if type(x) is str else ""
)
def test_frame_when_its_parts_disagree_is_refused(
    header: FrameHeader, parts: tuple[bytes, ...], said: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=said):
        frame_of(header, *parts)


def test_picture_when_of_another_size_than_the_header_says_is_refused() -> None:
    _, data = cv2.imencode(".png", np.zeros((5, 6, 3), np.uint8))
    with pytest.raises(RemoteProtocolError, match=r"shape \(5, 6, 3\)"):
        frame_of(dataclasses.replace(LAWFUL, encoding=Encoding.PNG), data.tobytes())
