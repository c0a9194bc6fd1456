"""Payloads of a frame: each encoding computed once, whatever the number of connections."""

from __future__ import annotations

import threading

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_server.frames import frame as frame_module
from catoptra_server.frames.frame import Frame


def make_frame(rgb: npt.NDArray[np.uint8]) -> Frame:
    return Frame(1, 0.0, rgb, 0.0, 0.0)


def make_image(height: int, width: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_payload_when_requested_by_concurrent_threads_is_encoded_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[ImageType] = []

    def count_encode(rgb: npt.NDArray[np.uint8], image_type: ImageType) -> bytes:
        calls.append(image_type)
        return b"payload"

    monkeypatch.setattr(frame_module, "encode_payload", count_encode)
    frame = make_frame(make_image(4, 4))
    threads = [threading.Thread(target=frame.encode, args=(ImageType.RAW,)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    frame.encode(ImageType.BAD)
    assert calls == [ImageType.RAW, ImageType.BAD]


def test_jpeg_when_requested_by_both_transports_is_encoded_once() -> None:
    frame = make_frame(make_image(8, 8))
    assert frame.encode(ImageEncoding.JPEG) is frame.encode(ImageType.GOOD)


def test_png_and_raw_of_the_stream_when_decoded_are_the_image() -> None:
    rgb = make_image(6, 5)
    frame = make_frame(rgb)
    png = cv2.imdecode(
        np.frombuffer(frame.encode(ImageEncoding.PNG), np.uint8), cv2.IMREAD_COLOR_RGB
    )
    np.testing.assert_array_equal(png, rgb)
    raw = np.frombuffer(frame.encode(ImageEncoding.RAW), np.uint8).reshape(rgb.shape)
    np.testing.assert_array_equal(raw, rgb)
