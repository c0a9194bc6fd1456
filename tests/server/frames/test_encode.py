"""Payloads of images: RAW byte by byte, JPEG by its quality, rectangles."""

from __future__ import annotations

import asyncio
import struct
import threading

import numpy as np
import numpy.typing as npt
import pytest

from catoptra_client.frame_sources.image_client import rgb_from_encoded_frame
from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import EncodedFrame, ImageType, encode_frame_header
from catoptra_server.frames import frame as encode_module
from catoptra_server.frames.frame import Payload, crop, encode_without_blocking, payload_of_reply

JPEGS = [t for t in ImageType if t is not ImageType.RAW]


def make_image(width: int, height: int) -> npt.NDArray[np.uint8]:
    """Image whose channels rise along u, v and both."""
    v, u = np.mgrid[:height, :width]
    rgb = np.stack((u * 255 // max(width - 1, 1), v * 255 // max(height - 1, 1), (u + v) % 256), -1)
    return rgb.astype(np.uint8)


def encode(rgb: npt.NDArray[np.uint8], encoding: ImageType | ImageEncoding) -> Payload:
    return asyncio.run(encode_without_blocking(rgb, encoding))


def encode_payload(rgb: npt.NDArray[np.uint8], image_type: ImageType) -> bytes:
    return bytes(payload_of_reply(encode(rgb, image_type)))


def test_raw_when_encoded_is_b_g_r_from_the_top_row_with_padding() -> None:
    rgb = np.array([[[1, 2, 3]], [[4, 5, 6]]], dtype=np.uint8)
    payload = encode_payload(rgb, ImageType.RAW)
    assert payload == struct.pack(">HH", 1, 2) + bytes((3, 2, 1, 0, 6, 5, 4, 0))


@pytest.mark.parametrize("size_px", [(1, 1), (3, 2), (4, 3), (5, 3), (641, 2), (640, 640)])
def test_raw_of_any_width_is_header_and_padded_rows(size_px: tuple[int, int]) -> None:
    width, height = size_px
    rgb = make_image(width, height)
    padding = ((0, 0), (0, -3 * width % 4))
    rows = np.pad(rgb[:, :, ::-1].reshape(height, 3 * width), padding)
    assert encode_payload(rgb, ImageType.RAW) == struct.pack(">HH", *size_px) + rows.tobytes()
    # A part of a larger image is not contiguous.
    part = crop(make_image(width + 2, height + 1), 1, 1, width, height)
    assert encode_payload(part, ImageType.RAW) == encode_payload(part.copy(), ImageType.RAW)


@pytest.mark.parametrize("image_type", ImageType, ids=lambda t: t.name)
def test_reply_of_the_image_port_is_header_and_payload_in_one_piece(image_type: ImageType) -> None:
    reply = encode(make_image(5, 3), image_type)
    payload = payload_of_reply(reply)
    assert bytes(reply) == encode_frame_header(image_type, len(payload)) + payload


def test_raw_of_the_stream_is_the_image_itself_without_a_copy() -> None:
    rgb = make_image(5, 3)
    assert np.shares_memory(np.frombuffer(encode(rgb, ImageEncoding.RAW), np.uint8), rgb)


@pytest.mark.parametrize(
    ("side_px", "encoding", "is_here"),
    [
        (640, ImageType.RAW, True),
        (640, ImageEncoding.RAW, True),
        (2048, ImageType.RAW, False),
        (8, ImageType.GOOD, False),
        (8, ImageEncoding.PNG, False),
    ],
)
def test_encoding_that_takes_long_runs_in_another_thread(
    side_px: int,
    encoding: ImageType | ImageEncoding,
    is_here: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    threads: list[int] = []

    def record(rgb: npt.NDArray[np.uint8], encoding: ImageType | ImageEncoding) -> bytes:
        threads.append(threading.get_ident())
        return b""

    monkeypatch.setattr(encode_module, "encode_image", record)
    rgb = np.zeros((side_px, side_px, 3), np.uint8)
    encode(rgb, encoding)
    assert (threads == [threading.get_ident()]) is is_here


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 360, 361])
def test_raw_when_decoded_by_the_client_is_the_image(width: int) -> None:
    rgb = make_image(width, 7)
    payload = encode_payload(rgb, ImageType.RAW)
    assert len(payload) == 4 + 7 * ((3 * width + 3) // 4 * 4)
    np.testing.assert_array_equal(rgb_from_encoded_frame(EncodedFrame(ImageType.RAW, payload)), rgb)


@pytest.mark.parametrize("image_type", JPEGS, ids=lambda t: t.name)
def test_jpeg_when_decoded_by_the_client_is_near_the_image(image_type: ImageType) -> None:
    rgb = make_image(64, 48)
    payload = encode_payload(rgb, image_type)
    assert payload[:2] == b"\xff\xd8"
    difference = rgb_from_encoded_frame(EncodedFrame(image_type, payload)).astype(int) - rgb
    # The worst quality, 10 of 100, is off by some levels on smooth ramps; channels are not swapped.
    assert np.abs(difference).mean() < 12.0


def test_jpeg_when_of_better_quality_is_larger() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    sizes = [len(encode_payload(noise, image_type)) for image_type in JPEGS]
    assert sizes == sorted(sizes, reverse=True)
    assert len(set(sizes)) == len(JPEGS)


@pytest.mark.parametrize(
    ("rectangle", "columns", "rows"),
    [
        ((0, 0, 8, 6), (0, 8), (0, 6)),
        ((2, 1, 3, 4), (2, 5), (1, 5)),
        ((6, 4, 9, 9), (6, 8), (4, 6)),
        ((0, 0, 0, 0), (0, 1), (0, 1)),
        ((8, 6, 1, 1), (7, 8), (5, 6)),
        ((2**32 - 1, 0, 2**32 - 1, 2**32 - 1), (7, 8), (0, 6)),
    ],
)
def test_rectangle_when_cropped_is_clamped_to_the_image(
    rectangle: tuple[int, int, int, int], columns: tuple[int, int], rows: tuple[int, int]
) -> None:
    rgb = make_image(8, 6)
    part = crop(rgb, *rectangle)
    np.testing.assert_array_equal(part, rgb[slice(*rows), slice(*columns)])
    assert encode_payload(part, ImageType.RAW)[:4] == struct.pack(">HH", *part.shape[1::-1])
