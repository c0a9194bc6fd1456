"""The protocol of the image port: requests in, frames out, and the client's side of both.

A frame is a type byte, a big-endian length, and a JPEG stream or a RAW image. The size that a JPEG
stream announces is read before decoding, so that a client can reject a huge image: the parser walks
the segments up to the start of frame and decodes nothing. Source: ImageServer.cpp,
UPISImageServer.uc of USARSim; SPEC.md 7; ITU-T T.81, B.1.1.3 and B.2.2.
"""

from __future__ import annotations

import re
import struct
from enum import IntEnum

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE_PX
from catoptra_protocol.slotted_dataclass import dataclass

_START_OF_IMAGE = b"\xff\xd8"
_SEGMENT_LENGTH = struct.Struct(">H")
# Length, bits per sample, height, width.
_START_OF_FRAME = struct.Struct(">HBHH")
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
            _, _, height, width = _START_OF_FRAME.unpack_from(payload, position)
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


_FRAME_HEADER = struct.Struct(">BI")
_RAW_HEADER = struct.Struct(">HH")
_REGION = struct.Struct(">4I")
_REQUEST_START = re.compile(rb"[OU]")
# Length of a request by its first byte.
_REQUEST_LENGTHS = {ord("O"): 2, ord("U"): 1 + _REGION.size}


class ImageType(IntEnum):
    """Type byte of a frame: RAW, or a JPEG of one of five qualities."""

    RAW = 0
    SUPER = 1
    GOOD = 2
    NORMAL = 3
    FAIR = 4
    BAD = 5

    @classmethod
    def from_text(cls, text: str) -> ImageType:
        """Image type of a tag in any case or of a number; empty means NORMAL, as in UDK.

        Raises:
            LocalProtocolError: The text is no type; lists the types.
        """
        tag = text.strip().upper() or "NORMAL"
        for image_type in cls:
            if tag in (image_type.name, str(image_type.value)):
                return image_type
        tags = ", ".join(f"{image_type.name} ({image_type.value})" for image_type in cls)
        raise LocalProtocolError(f"image type {text!r}: expected one of {tags}")


# Qualities of FreeImage behind the tags: SUPERB, GOOD, NORMAL, AVERAGE, BAD.
JPEG_QUALITY: dict[ImageType, int] = {
    ImageType.SUPER: 100,
    ImageType.GOOD: 75,
    ImageType.NORMAL: 50,
    ImageType.FAIR: 25,
    ImageType.BAD: 10,
}


@dataclass(frozen=True, slots=True)
class FullFrameRequest:
    """Request for the full picture: `OK`."""


@dataclass(frozen=True, slots=True)
class RegionRequest:
    """Request for a rectangular region of the picture, in pixels: `U` and 16 bytes.

    The region may lie outside the picture: SPEC.md 7.3.
    """

    # Unsigned on the wire, so a region may begin beyond the picture but never before it.
    x: int
    y: int
    width: int
    height: int


ImageRequest = FullFrameRequest | RegionRequest

_FULL_FRAME_REQUEST = FullFrameRequest()


class ImageRequestReader:
    """Parser of the requests in a client's bytes, in any segmentation.

    `OK` requests the full picture; `U` and 16 bytes a region; `O` and any other byte are both
    discarded; every other byte is ignored. At most 16 bytes stay buffered. The caller owes one
    frame per request and must not read further until then, so that TCP holds back the rest: no
    request is lost and no queue grows.
    """

    def __init__(self) -> None:
        self._pending = b""

    def receive(self, data: bytes) -> list[ImageRequest]:
        """Requests completed by these bytes."""
        data = self._pending + data
        requests: list[ImageRequest] = []
        position = 0
        # Bytes outside requests are skipped by the search.
        while start := _REQUEST_START.search(data, position):
            begin, position = start.start(), start.start() + _REQUEST_LENGTHS[start[0][0]]
            # An incomplete request at the end: buffered from its first byte, so it is searched
            # again whole.
            if position > len(data):
                self._pending = data[begin:]
                return requests
            requests += _parse_request(data[begin:position])
        self._pending = b""
        return requests


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """A frame as received."""

    image_type: ImageType
    payload: bytes
    """A JPEG stream, or a RAW header and rows of B, G, R bytes."""

    def __str__(self) -> str:
        return f"{self.image_type.name} frame of {len(self.payload)} bytes"


class ImageFrameReader:
    """Parser of the frames in a server's bytes, in any segmentation; copies each byte twice."""

    def __init__(self, max_payload_bytes: int = MAX_IMAGE_PAYLOAD_BYTES) -> None:
        self._buffer = bytearray()
        self._max_payload_bytes = max_payload_bytes

    def receive(self, data: bytes) -> list[EncodedFrame]:
        """Frames completed by these bytes.

        Raises:
            RemoteProtocolError: A header has an unknown type or a payload beyond the limit.
                Raised before the payload arrives; the connection is unusable afterwards.
        """
        self._buffer += data
        frames = []
        while (frame := self._next_frame()) is not None:
            frames.append(frame)
        return frames

    def _next_frame(self) -> EncodedFrame | None:
        if len(self._buffer) < _FRAME_HEADER.size:
            return None
        image_type, length = self._read_header()
        end = _FRAME_HEADER.size + length
        if len(self._buffer) < end:
            return None
        # The view is released before the buffer shrinks: a bytearray with an exported view cannot
        # resize.
        with memoryview(self._buffer) as view:
            payload = bytes(view[_FRAME_HEADER.size : end])
        del self._buffer[:end]  # moves the start of a bytearray, not its bytes
        return EncodedFrame(image_type, payload)

    def _read_header(self) -> tuple[ImageType, int]:
        image_type, length = _FRAME_HEADER.unpack_from(self._buffer)
        if image_type > max(ImageType):
            raise RemoteProtocolError(
                f"frame of type {image_type}: expected 0 (RAW) to 5; is this the image port?"
            )
        # Checked as soon as the header arrives, before any byte of the payload is buffered.
        if length > self._max_payload_bytes:
            raise RemoteProtocolError(
                f"frame of {length} bytes: the limit is {self._max_payload_bytes}"
            )
        return ImageType(image_type), length


def encode_full_frame_request() -> bytes:
    """Bytes of the request for one full frame."""
    return b"OK"


def encode_frame_header(image_type: ImageType, payload_length: int) -> bytes:
    """The 5 bytes before a payload.

    Raises:
        LocalProtocolError: The length exceeds 32 bits.
    """
    if not 0 <= payload_length <= 0xFFFFFFFF:
        raise LocalProtocolError(f"a payload of {payload_length} bytes does not fit its header")
    return _FRAME_HEADER.pack(image_type, payload_length)


def encode_raw_header(width: int, height: int) -> bytes:
    """The 4 bytes before the rows of a RAW image.

    Rows follow top first, pixels as B, G, R, each row padded to `_raw_row_pitch(width)` bytes.

    Raises:
        LocalProtocolError: A side exceeds 16 bits.
    """
    if not (0 <= width <= MAX_IMAGE_SIDE_PX and 0 <= height <= MAX_IMAGE_SIDE_PX):
        raise LocalProtocolError(f"a RAW picture of {width} x {height} px does not fit its header")
    return _RAW_HEADER.pack(width, height)


def _raw_row_pitch(width: int) -> int:
    """Bytes of a RAW row: 3 per pixel, rounded up to a multiple of 4 as in FreeImage.

    Some clients assume 3 * width: serve widths divisible by 4.
    """
    return (3 * width + 3) // 4 * 4


def parse_raw_size(payload: bytes) -> tuple[int, int, int]:
    """Width, height and row pitch of a RAW payload; rows may be padded or not.

    Raises:
        RemoteProtocolError: Header and length disagree.
    """
    if len(payload) < _RAW_HEADER.size:
        raise RemoteProtocolError(f"RAW frame of {len(payload)} bytes: its header alone has 4")
    width, height = _RAW_HEADER.unpack_from(payload)
    # Padded first: both pitches agree for widths divisible by 4, and the reference pads.
    for pitch in (_raw_row_pitch(width), 3 * width):
        if len(payload) == _RAW_HEADER.size + height * pitch:
            return width, height, pitch
    raise RemoteProtocolError(
        f"RAW frame of {width} x {height} px in {len(payload)} bytes: expected "
        f"{_RAW_HEADER.size + height * _raw_row_pitch(width)}"
    )


def _parse_request(data: bytes) -> list[ImageRequest]:
    """Request of a complete sequence that begins with O or U; none for `O` and another byte."""
    if data[:1] == b"U":
        return [RegionRequest(*_REGION.unpack_from(data, 1))]
    return [_FULL_FRAME_REQUEST] if data == b"OK" else []
