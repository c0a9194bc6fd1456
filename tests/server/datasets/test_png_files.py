"""PNG files: read by OpenCV and by the twin decoder, the same bytes each time."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_server.datasets.png_files import decode_png, encode_png

RANDOM = np.random.default_rng(1)
RAMP = np.add.outer(np.arange(40), 3 * np.arange(50))
IMAGES = {
    "one pixel": np.array([[7]], dtype=np.uint8),
    "one column": np.arange(5, dtype=np.uint8)[:, None],
    "flat": np.full((9, 4, 3), 200, dtype=np.uint8),
    "ramp": np.stack((RAMP, RAMP + 1, 255 - RAMP), axis=-1).astype(np.uint8),
    "noise": RANDOM.integers(0, 256, (31, 17, 3)).astype(np.uint8),
    "grey noise": RANDOM.integers(0, 256, (13, 8)).astype(np.uint8),
    "ids": (RAMP // 20 * 300).astype(np.uint16),
    "largest": np.full((3, 3), 65535, dtype=np.uint16),
}


@pytest.mark.parametrize("name", IMAGES)
def test_image_is_read_by_opencv_and_by_the_decoder(name: str) -> None:
    image = IMAGES[name]
    content = encode_png(image)
    other = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert other.dtype == image.dtype
    np.testing.assert_array_equal(other[..., ::-1] if image.ndim == 3 else other, image)
    own = decode_png(content)
    assert own.dtype == image.dtype
    np.testing.assert_array_equal(own, image)


def test_bytes_do_not_depend_on_the_layout_in_memory() -> None:
    image = IMAGES["ramp"]
    assert encode_png(np.asfortranarray(image)) == encode_png(image)


@pytest.mark.parametrize("place", [3, 20, 50, -20])
def test_file_when_a_byte_differs_is_refused(place: int) -> None:
    content = bytearray(encode_png(IMAGES["noise"]))
    content[place] ^= 1
    with pytest.raises(DomainError, match="no PNG file"):
        decode_png(bytes(content))


@pytest.mark.parametrize("length", [0, 8, 30, 200])
def test_file_when_cut_off_is_refused(length: int) -> None:
    with pytest.raises(DomainError, match="no PNG file"):
        decode_png(encode_png(IMAGES["noise"])[:length])


@pytest.mark.parametrize(
    "image", [np.zeros((2, 2)), np.zeros((2, 2, 2), np.uint8), np.zeros((0, 2), np.uint8)]
)
def test_image_of_another_kind_is_refused(image: np.ndarray) -> None:
    with pytest.raises(DomainError, match="no PNG file of"):
        encode_png(image)
