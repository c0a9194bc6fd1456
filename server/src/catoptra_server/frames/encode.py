"""Images encoded to payloads of both image transports; the only module here that imports cv2."""

from __future__ import annotations

import cv2
import numpy as np

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import JPEG_QUALITY, ImageType, encode_raw_header
from catoptra_server.render.renderer import Image

# One thread encodes: OpenCV's own pool would compete with the renderer's threads for the cores.
cv2.setNumThreads(1)


def encode_payload(rgb: Image, encoding: ImageType | ImageEncoding) -> bytes:
    """Encode an image for a transport.

    Args:
        rgb: (h, w, 3) uint8.
        encoding: A type of USARSim's image port: JPEG of some quality, or RAW with header, B G R
            and padded rows. Or an encoding of the stream: raw R G B rows, JPEG or PNG.
    """
    if encoding is ImageEncoding.RAW:
        return rgb.tobytes()
    bgr = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2BGR)
    if encoding is ImageType.RAW:
        return _encode_raw(bgr)
    if encoding is ImageEncoding.PNG:
        # Level 1: a third of the default's time for a tenth more bytes.
        return _encode_file(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    # The stream does not choose a quality; GOOD is the image port's default.
    image_type = ImageType.GOOD if encoding is ImageEncoding.JPEG else encoding
    return _encode_file(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY[image_type]])


def _encode_raw(bgr: Image) -> bytes:
    height, width = bgr.shape[:2]
    # The original server pads rows to four bytes, and clients differ: see SPEC-NOTES.md.
    padding = -3 * width % 4
    rows = bgr.reshape(height, 3 * width)
    padded = np.pad(rows, ((0, 0), (0, padding))) if padding else rows
    return encode_raw_header(width, height) + padded.tobytes()


def _encode_file(suffix: str, bgr: Image, options: list[int]) -> bytes:
    ok, stream = cv2.imencode(suffix, bgr, options)
    assert ok, "cv2 encodes every 8-bit image"
    payload: bytes = stream.tobytes()
    return payload


def crop(rgb: Image, x: int, y: int, width: int, height: int) -> Image:
    """Part of an image inside a rectangle clamped to the image; at least one pixel."""
    rows, columns = rgb.shape[:2]
    # USARSim leaves a rectangle outside the image undefined; here its nearest pixel is returned.
    left, top = min(x, columns - 1), min(y, rows - 1)
    right = min(max(x + width, left + 1), columns)
    bottom = min(max(y + height, top + 1), rows)
    return rgb[top:bottom, left:right]
