"""A finished picture is encoded once for all who ask for the same kind."""

from __future__ import annotations

import threading

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.wire.image import ImageType
from catoptra_protocol.wire.stream_requests import Encoding
from catoptra_server.imaging import frame as frame_module
from catoptra_server.imaging.frame import Frame


def frame_of(rgb: npt.NDArray[np.uint8]) -> Frame:
    return Frame(1, 0.0, rgb, 0.0, 0.0)


def picture(height: int, width: int) -> npt.NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_payload_when_asked_for_by_threads_at_once_is_encoded_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[ImageType] = []

    def counted(rgb: npt.NDArray[np.uint8], image_type: ImageType) -> bytes:
        calls.append(image_type)
        return b"payload"

    monkeypatch.setattr(frame_module, "encoded_payload", counted)
    frame = frame_of(picture(4, 4))
    threads = [threading.Thread(target=frame.payload, args=(ImageType.RAW,)) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    frame.payload(ImageType.BAD)
    assert calls == [ImageType.RAW, ImageType.BAD]


def test_jpeg_when_asked_for_by_both_transports_is_one() -> None:
    frame = frame_of(picture(8, 8))
    assert frame.payload(Encoding.JPEG) is frame.payload(ImageType.GOOD)


def test_png_and_raw_of_the_stream_when_decoded_are_the_picture() -> None:
    rgb = picture(6, 5)
    frame = frame_of(rgb)
    png = cv2.imdecode(np.frombuffer(frame.payload(Encoding.PNG), np.uint8), cv2.IMREAD_COLOR_RGB)
    np.testing.assert_array_equal(png, rgb)
    raw = np.frombuffer(frame.payload(Encoding.RAW), np.uint8).reshape(rgb.shape)
    np.testing.assert_array_equal(raw, rgb)
