"""Complete and damaged encodings of frames."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_client.frame import image_bytes_from_rgb
from catoptra_protocol.usarsim.image_port import EncodedFrame, ImageType
from conformance.check import CheckFailed
from conformance.image_session import decode_completely

RGB = np.random.default_rng(1).integers(0, 255, (48, 64, 3), np.uint8)
JPEG = image_bytes_from_rgb(RGB, ".jpg")


@pytest.mark.parametrize("end", [b"", b"\0\0"], ids=["exact", "padded"])
def test_jpeg_when_complete_is_decoded(end: bytes) -> None:
    assert decode_completely(EncodedFrame(ImageType.GOOD, JPEG + end)).shape == RGB.shape


def test_jpeg_when_cut_off_fails() -> None:
    for payload in (JPEG[:-2], JPEG[: len(JPEG) // 2]):
        with pytest.raises(CheckFailed, match="expected the marker ff d9"):
            decode_completely(EncodedFrame(ImageType.GOOD, payload))
