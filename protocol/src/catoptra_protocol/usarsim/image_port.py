"""The image server's protocol: requests in, frames out, and the client's side of both.

A frame is a type byte, a big-endian length, and a JPEG stream or a RAW picture. Source:
ImageServer.cpp, UPISImageServer.uc of USARSim; SPEC.md 7.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from enum import IntEnum

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES, MAX_IMAGE_SIDE_PX

_FRAME_HEADER = struct.Struct(">BI")
_RAW_HEADER = struct.Struct(">HH")
_REGION = struct.Struct(">4I")
_REQUEST_START = re.compile(rb"[OU]")
_REQUEST_LENGTHS = {ord("O"): 2, ord("U"): 1 + _REGION.size}


class ImageType(IntEnum):
    """The type byte of a frame: RAW, or a JPEG of one of five qualities."""

    RAW = 0
    SUPER = 1
    GOOD = 2
    NORMAL = 3
    FAIR = 4
    BAD = 5

    @classmethod
    def from_text(cls, text: str) -> ImageType:
        """Return the type of a tag in any case or of a number; empty means NORMAL, as in UDK."""
        tag = text.strip().upper() or "NORMAL"
        for image_type in cls:
            if tag in (image_type.name, str(image_type.value)):
                return image_type
        tags = ", ".join(f"{image_type.name} ({image_type.value})" for image_type in cls)
        raise LocalProtocolError(f"image type {text!r}: expected one of {tags}")


# FreeImage's qualities behind the tags: SUPERB, GOOD, NORMAL, AVERAGE, BAD.
JPEG_QUALITY: dict[ImageType, int] = {
    ImageType.SUPER: 100,
    ImageType.GOOD: 75,
    ImageType.NORMAL: 50,
    ImageType.FAIR: 25,
    ImageType.BAD: 10,
}


@dataclass(frozen=True, slots=True)
class FullFrameRequest:
    """A request for the whole picture: `OK`."""


@dataclass(frozen=True, slots=True)
class RegionRequest:
    """A request for a rectangle of the picture, in pixels: `U` and 16 bytes.

    Nothing says that it lies inside the picture: SPEC.md 7.3.
    """

    x: int
    y: int
    width: int
    height: int


ImageRequest = FullFrameRequest | RegionRequest

_FULL_FRAME_REQUEST = FullFrameRequest()


class ImageRequestReader:
    """Find the requests in a client's bytes, however they are cut.

    `OK` asks for the whole picture; `U` and 16 bytes for a rectangle; `O` and any other byte are
    both swallowed; every other byte is nothing. At most 16 bytes are kept. Each request is owed one
    frame; whoever serves them reads no further until they are answered, so that TCP holds back the
    rest: no request is lost and no queue grows.
    """

    def __init__(self) -> None:
        self._pending = b""

    def receive(self, data: bytes) -> list[ImageRequest]:
        """Return the requests that these bytes complete."""
        data = self._pending + data
        requests: list[ImageRequest] = []
        position = 0
        while start := _REQUEST_START.search(data, position):
            begin, position = start.start(), start.start() + _REQUEST_LENGTHS[start[0][0]]
            if position > len(data):
                self._pending = data[begin:]
                return requests
            requests += _parse_request(data[begin:position])
        self._pending = b""
        return requests


@dataclass(frozen=True, slots=True)
class EncodedFrame:
    """A frame as it came: its payload is a JPEG stream, or a RAW header and rows of B, G, R."""

    image_type: ImageType
    payload: bytes

    def __str__(self) -> str:
        return f"{self.image_type.name} frame of {len(self.payload)} bytes"


class ImageFrameReader:
    """Collect frames from a server's bytes, however they are cut. Each byte is copied twice."""

    def __init__(self, max_payload_bytes: int = MAX_IMAGE_PAYLOAD_BYTES) -> None:
        self._buffer = bytearray()
        self._max_payload_bytes = max_payload_bytes

    def receive(self, data: bytes) -> list[EncodedFrame]:
        """Return the frames that these bytes complete.

        Raises RemoteProtocolError for an unknown type or a payload beyond the limit, as soon as its
        header is there; the connection is not to be used after it.
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
        if length > self._max_payload_bytes:
            raise RemoteProtocolError(
                f"frame of {length} bytes: more than the {self._max_payload_bytes} that we accept"
            )
        return ImageType(image_type), length


def encode_full_frame_request() -> bytes:
    """Return the request for one whole frame."""
    return b"OK"


def encode_frame_header(image_type: ImageType, payload_length: int) -> bytes:
    """Return the 5 bytes before a payload."""
    if not 0 <= payload_length <= 0xFFFFFFFF:
        raise LocalProtocolError(f"a payload of {payload_length} bytes does not fit its header")
    return _FRAME_HEADER.pack(image_type, payload_length)


def encode_raw_header(width: int, height: int) -> bytes:
    """Return the 4 bytes before the rows of a RAW picture.

    Rows follow top first, pixels as B, G, R, each row padded to `raw_row_pitch(width)` bytes.
    """
    if not (0 <= width <= MAX_IMAGE_SIDE_PX and 0 <= height <= MAX_IMAGE_SIDE_PX):
        raise LocalProtocolError(f"a RAW picture of {width} x {height} px does not fit its header")
    return _RAW_HEADER.pack(width, height)


def raw_row_pitch(width: int) -> int:
    """Return the bytes of a RAW row: 3 a pixel, rounded up to a multiple of 4 as FreeImage does.

    Some clients take it to be 3 * width: serve widths divisible by 4.
    """
    return (3 * width + 3) // 4 * 4


def parse_raw_size(payload: bytes) -> tuple[int, int, int]:
    """Return (width, height, pitch) of a RAW payload; rows may be padded or not.

    Raises RemoteProtocolError if header and length disagree.
    """
    if len(payload) < _RAW_HEADER.size:
        raise RemoteProtocolError(f"RAW frame of {len(payload)} bytes: its header alone has 4")
    width, height = _RAW_HEADER.unpack_from(payload)
    for pitch in (raw_row_pitch(width), 3 * width):
        if len(payload) == _RAW_HEADER.size + height * pitch:
            return width, height, pitch
    raise RemoteProtocolError(
        f"RAW frame of {width} x {height} px in {len(payload)} bytes: expected "
        f"{_RAW_HEADER.size + height * raw_row_pitch(width)}"
    )


def _parse_request(data: bytes) -> list[ImageRequest]:
    """Return what a complete sequence that began with O or U asks for: one request or none."""
    if data[:1] == b"U":
        return [RegionRequest(*_REGION.unpack_from(data, 1))]
    return [_FULL_FRAME_REQUEST] if data == b"OK" else []
