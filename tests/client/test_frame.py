"""Image files: decoded, or rejected before memory is allocated."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from catoptra_client.frame import rgb_from_image_bytes
from catoptra_protocol.errors import RemoteProtocolError

PICTURE = np.zeros((4, 6, 3), np.uint8)
PICTURE[..., 0] = 250


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_file_when_decoded_has_red_first(suffix: str) -> None:
    _, data = cv2.imencode(suffix, np.ascontiguousarray(PICTURE[..., ::-1]))
    # A flat picture: quality 95 still rounds in YCbCr.
    assert np.abs(rgb_from_image_bytes(data.tobytes()).astype(int) - PICTURE).max() <= 4


BAD_FILES = [
    (b"", "JPEG"),
    (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\xff\xff\xff\xff\0\0\0\1", "PNG frame of 4294967295 x 1"),
    (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\1\0\0\0\1", "PNG frame of 24 bytes"),
]


@pytest.mark.parametrize(("data", "said"), BAD_FILES)
def test_file_when_no_image_or_too_large_is_rejected(data: bytes, said: str) -> None:
    with pytest.raises(RemoteProtocolError, match=said):
        rgb_from_image_bytes(data)
