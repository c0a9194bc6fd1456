"""Size that a JPEG stream announces, so that a client can reject an image before decoding.

The parser walks the segments up to the start of frame (ITU-T T.81, B.1.1.3 and B.2.2) and decodes
nothing.
"""

from __future__ import annotations

import struct

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_PIXELS

_START_OF_IMAGE = b"\xff\xd8"
_SEGMENT_LENGTH = struct.Struct(">H")
# Length, bits per sample, height, width.
_FRAME_HEADER = struct.Struct(">HBHH")
# SOF0 to SOF15 without the three other markers in this range: DHT, JPG, DAC.
_START_OF_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


def parse_jpeg_size(payload: bytes) -> tuple[int, int]:
    """Width and height in pixels.

    Raises:
        RemoteProtocolError: The stream announces no size, or more pixels than MAX_IMAGE_PIXELS.
    """
    try:
        width, height = _find_frame_size(payload)
    except struct.error as error:
        raise RemoteProtocolError(
            f"JPEG frame of {len(payload)} bytes that ends before its size"
        ) from error
    # The decoder would allocate the announced size before reading a pixel.
    if not 0 < width * height <= MAX_IMAGE_PIXELS:
        raise RemoteProtocolError(
            f"JPEG frame of {width} x {height} px: expected 1 to {MAX_IMAGE_PIXELS} pixels"
        )
    return width, height


def _find_frame_size(payload: bytes) -> tuple[int, int]:
    """Width and height of the first start of frame; struct.error where the bytes end."""
    if not payload.startswith(_START_OF_IMAGE):
        raise RemoteProtocolError(f"JPEG frame that starts with {payload[:2]!r}: that is no JPEG")
    position = len(_START_OF_IMAGE)
    while True:
        marker, position = _read_marker(payload, position)
        if marker in _START_OF_FRAME_MARKERS:
            _, _, height, width = _FRAME_HEADER.unpack_from(payload, position)
            return width, height
        position += _SEGMENT_LENGTH.unpack_from(payload, position)[0]


def _read_marker(payload: bytes, position: int) -> tuple[int, int]:
    """Marker at a position, and the position after it; fill bytes may precede the marker."""
    start = position
    while payload[position : position + 1] == b"\xff":
        position += 1
    if position == start and position < len(payload):
        raise RemoteProtocolError(f"JPEG frame without a marker at byte {position}")
    return struct.unpack_from("B", payload, position)[0], position + 1
