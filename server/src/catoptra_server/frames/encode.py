"""Images encoded for both image transports; the only module here that imports OpenCV.

OpenCV is loaded before the first JPEG or PNG can be requested, by `load_opencv`; RAW frames before
that are swapped by NumPy, in 0.7 ms at 640 x 640 px instead of 0.1.

Raw frames up to 4 MiB are encoded on the event loop, in 0.1 ms; other encodings take one worker
thread for all clients (`frame.py:Frame.encode`). The rest of a frame's sending is the system's:
`sendfile` of a frame in memory took 1.2 times the time of one `send`, `splice` 1.6 times, with a
new file for each frame 2.9 times; other socket buffers changed nothing.
"""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.image_port import (
    JPEG_QUALITY,
    ImageType,
    encode_frame_header,
    encode_raw_header,
)
from catoptra_server.render.renderer import Image

Payload = bytes | memoryview
_FRAME_HEADER_BYTES = len(encode_frame_header(ImageType.GOOD, 0))
# Raw images up to this size take 0.1 ms, and a hop to another thread and back 0.4 ms of processor
# time; larger ones, and JPEG and PNG, would hold up the event loop.
_MAX_QUICK_BYTES = 4 * 2**20
# The module cv2; None until `load_opencv`.
_cv2: Any = None


def load_opencv() -> None:
    """Load OpenCV, which takes a tenth of a start."""
    global _cv2
    import cv2

    # One thread encodes: OpenCV's own pool would compete with the renderer's threads for the cores.
    cv2.setNumThreads(1)
    _cv2 = cv2


async def encode_without_blocking(rgb: Image, encoding: ImageType | ImageEncoding) -> Payload:
    """Encode an image for a transport, without holding up the event loop.

    Args:
        rgb: (h, w, 3) uint8.
        encoding: A type of USARSim's image port: JPEG of some quality, or RAW with header, B G R
            and padded rows. Or an encoding of the stream: raw R G B rows, JPEG or PNG.

    Returns:
        For the image port header and payload of the reply in one piece, so that one call sends
        both; for the stream the payload.
    """
    if is_quick(rgb, encoding):
        return _encode_image(rgb, encoding)
    return await asyncio.to_thread(_encode_image, rgb, encoding)


def is_quick(rgb: Image, encoding: ImageType | ImageEncoding) -> bool:
    """Whether an encoding of an image takes less time than a hop to another thread."""
    return encoding in (ImageType.RAW, ImageEncoding.RAW) and rgb.nbytes <= _MAX_QUICK_BYTES


def payload_of_reply(reply: Payload) -> memoryview:
    """Payload of a reply of the image port, without a copy."""
    return memoryview(reply)[_FRAME_HEADER_BYTES:]


def crop(rgb: Image, x: int, y: int, width: int, height: int) -> Image:
    """Part of an image inside a rectangle clamped to the image; at least one pixel."""
    rows, columns = rgb.shape[:2]
    # USARSim leaves a rectangle outside the image undefined; here its nearest pixel is returned.
    left, top = min(x, columns - 1), min(y, rows - 1)
    right = min(max(x + width, left + 1), columns)
    bottom = min(max(y + height, top + 1), rows)
    return rgb[top:bottom, left:right]


def _encode_image(rgb: Image, encoding: ImageType | ImageEncoding) -> Payload:
    if encoding is ImageEncoding.RAW:
        return np.ascontiguousarray(rgb).data.cast("B")
    # The stream does not choose a quality; GOOD is the image port's default.
    if encoding is ImageEncoding.JPEG:
        return payload_of_reply(_encode_image(rgb, ImageType.GOOD))
    if encoding is ImageType.RAW:
        return _encode_raw(rgb)
    if _cv2 is None:
        load_opencv()
    bgr = _cv2.cvtColor(np.ascontiguousarray(rgb), _cv2.COLOR_RGB2BGR)
    if encoding is ImageEncoding.PNG:
        # Level 1: a third of the default's time for a tenth more bytes.
        return _encode_file(".png", bgr, [_cv2.IMWRITE_PNG_COMPRESSION, 1])
    file = _encode_file(".jpg", bgr, [_cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY[encoding]])
    return encode_frame_header(encoding, len(file)) + file


def _encode_raw(rgb: Image) -> memoryview:
    height, width = rgb.shape[:2]
    # The original server pads rows to four bytes, and clients differ: see SPEC-NOTES.md.
    row_bytes = 3 * width + -3 * width % 4
    raw_header = encode_raw_header(width, height)
    payload_bytes = len(raw_header) + height * row_bytes
    header = encode_frame_header(ImageType.RAW, payload_bytes) + raw_header
    # Converted into its place in the reply: 0.05 ms at 640 x 640 px, and 0.09 if joined afterwards.
    reply = np.empty(len(header) + height * row_bytes, np.uint8)
    reply[: len(header)] = np.frombuffer(header, np.uint8)
    rows = reply[len(header) :].reshape(height, row_bytes)
    rows[:, 3 * width :] = 0
    bgr = rows[:, : 3 * width].reshape(height, width, 3)
    if _cv2 is not None:
        _cv2.cvtColor(np.ascontiguousarray(rgb), _cv2.COLOR_RGB2BGR, dst=bgr)
    else:
        # Channel by channel: four times as fast as one copy of reversed pixels.
        for channel in range(3):
            bgr[..., channel] = rgb[..., 2 - channel]
    return reply.data


def _encode_file(suffix: str, bgr: Image, options: list[int]) -> bytes:
    ok, stream = _cv2.imencode(suffix, bgr, options)
    assert ok, "cv2 encodes every 8-bit image"
    payload: bytes = stream.tobytes()
    return payload
