"""The size that a JPEG stream announces."""

from __future__ import annotations

import contextlib
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim.image_port import parse_jpeg_size

START = b"\xff\xd8"
COMMENT = b"\xff\xfe\x00\x04hi"


def start_of_frame(width: int, height: int, marker: int = 0xC0) -> bytes:
    """Start-of-frame segment up to its size."""
    return struct.pack(">BBHBHH", 0xFF, marker, 17, 8, height, width)


SIZES = [
    START + start_of_frame(640, 480),
    START + COMMENT + start_of_frame(640, 480),
    START + COMMENT + b"\xff\xff\xff" + start_of_frame(640, 480),  # fill bytes
    START + start_of_frame(640, 480, marker=0xC2),  # progressive
    START + b"\xff\xc4\x00\x02" + start_of_frame(640, 480),  # a Huffman table is no frame
]


@pytest.mark.parametrize("payload", SIZES)
def test_jpeg_size_when_announced_is_found(payload: bytes) -> None:
    assert parse_jpeg_size(payload) == (640, 480)


BAD = [
    (b"", "no JPEG"),
    (b"\x89PNG", "no JPEG"),
    (START, "ends before"),
    (START + COMMENT, "ends before"),
    (START + start_of_frame(640, 480)[:6], "ends before"),
    (START + b"\xff", "ends before"),
    (START + b"hi", "without a marker"),
    (START + b"\xff\xfe\x00\x00" + start_of_frame(640, 480), "without a marker"),
    (START + start_of_frame(65535, 65535), "expected 1 to"),
    (START + start_of_frame(0, 480), "expected 1 to"),
]


@pytest.mark.parametrize(("payload", "expected_message"), BAD)
def test_jpeg_size_when_missing_or_too_large_raises(payload: bytes, expected_message: str) -> None:
    with pytest.raises(RemoteProtocolError, match=expected_message):
        parse_jpeg_size(payload)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(st.sampled_from([b"\xff", b"\xc0", b"\0", COMMENT]) | st.binary(max_size=6)))
def test_jpeg_size_of_any_bytes_ends_with_a_size_or_raises(pieces: list[bytes]) -> None:
    size = (1, 1)
    with contextlib.suppress(RemoteProtocolError):
        size = parse_jpeg_size(START + b"".join(pieces))
    assert min(size) > 0
