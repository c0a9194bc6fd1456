"""Requests and frames of the image port, and the size of a JPEG."""

from __future__ import annotations

import contextlib
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_PAYLOAD_BYTES
from catoptra_protocol.usarsim.image_port import (
    JPEG_QUALITY,
    EncodedFrame,
    FullFrameRequest,
    ImageFrameReader,
    ImageRequest,
    ImageRequestReader,
    ImageType,
    RegionRequest,
    encode_frame_header,
    encode_full_frame_request,
    encode_raw_header,
    parse_jpeg_size,
    parse_raw_size,
)

DETERMINISTIC = settings(derandomize=True, max_examples=200, deadline=None)

WHOLE = FullFrameRequest()
RECTANGLE = struct.pack(">4I", 320, 0, 640, 480)
REGION = RegionRequest(320, 0, 640, 480)
# A rectangle whose 16 bytes spell requests.
REGION_SPELLING_REQUESTS = b"OKOKUOKOKOKOKOKO"

TAGS = [
    ("RAW", ImageType.RAW),
    ("super", ImageType.SUPER),
    ("Good", ImageType.GOOD),
    ("NORMAL", ImageType.NORMAL),
    ("fair", ImageType.FAIR),
    (" BAD ", ImageType.BAD),
    ("0", ImageType.RAW),
    ("5", ImageType.BAD),
    ("", ImageType.NORMAL),
]


@pytest.mark.parametrize(("text", "image_type"), TAGS)
def test_image_type_is_parsed_from_tag_or_number(text: str, image_type: ImageType) -> None:
    assert ImageType.from_text(text) is image_type


@pytest.mark.parametrize("text", ["6", "-1", "JPEG", "1.0"])
def test_image_type_when_unknown_lists_the_known_ones(text: str) -> None:
    with pytest.raises(LocalProtocolError, match=r"RAW \(0\), SUPER \(1\)"):
        ImageType.from_text(text)


def test_jpeg_quality_is_that_of_the_reference() -> None:
    qualities = [JPEG_QUALITY.get(image_type) for image_type in ImageType]
    assert qualities == [None, 100, 75, 50, 25, 10]


REQUESTS: list[tuple[bytes, list[ImageRequest]]] = [
    (b"", []),
    (b"OK", [WHOLE]),
    (b"OK\r\n", [WHOLE]),
    (b"OK\n", [WHOLE]),
    (b" \0\r\nOK\0", [WHOLE]),
    (b"OKOKOK", [WHOLE] * 3),
    (b"O", []),
    (b"K", []),
    (b"ok", []),
    (b"O OK", [WHOLE]),
    (b"OOK", []),  # O and the next byte are both swallowed
    (b"OOOK", [WHOLE]),
    (b"OU" + RECTANGLE, []),
    (b"U" + RECTANGLE, [REGION]),
    (b"\0\0\0U" + RECTANGLE, [REGION]),  # the Qt client's form
    (b"U" + RECTANGLE + b"OK", [REGION, WHOLE]),
    (
        b"U" + REGION_SPELLING_REQUESTS,
        [RegionRequest(*struct.unpack(">4I", REGION_SPELLING_REQUESTS))],
    ),
    (b"U" + REGION_SPELLING_REQUESTS[:15], []),
    (b"U" + b"\xff" * 16, [RegionRequest(*[0xFFFFFFFF] * 4)]),
]


@pytest.mark.parametrize(("data", "requests"), REQUESTS)
@pytest.mark.parametrize("size", [1, 2, 5, 16, 1000])
def test_request_reader_in_any_segmentation_finds_the_requests(
    data: bytes, requests: list[ImageRequest], size: int
) -> None:
    reader = ImageRequestReader()
    found = [r for i in range(0, len(data), size) for r in reader.receive(data[i : i + size])]
    assert found == requests


@DETERMINISTIC
@given(st.lists(st.sampled_from([b"O", b"K", b"U", b"OK", RECTANGLE]) | st.binary(max_size=20)))
def test_request_reader_of_any_bytes_does_not_depend_on_segmentation(chunks: list[bytes]) -> None:
    reader = ImageRequestReader()
    cut = [request for chunk in chunks for request in reader.receive(chunk)]
    assert cut == ImageRequestReader().receive(b"".join(chunks))


def test_request_reader_finds_the_request_of_our_client() -> None:
    assert ImageRequestReader().receive(encode_full_frame_request()) == [WHOLE]


def test_frame_header_when_packed_is_type_and_big_endian_length() -> None:
    assert encode_frame_header(ImageType.GOOD, 0x01020304) == b"\x02\x01\x02\x03\x04"


@pytest.mark.parametrize("length", [-1, 2**32])
def test_frame_header_when_the_length_does_not_fit_raises(length: int) -> None:
    with pytest.raises(LocalProtocolError, match="does not fit"):
        encode_frame_header(ImageType.RAW, length)


def encode_frame(frame: EncodedFrame) -> bytes:
    return encode_frame_header(frame.image_type, len(frame.payload)) + frame.payload


FRAMES = st.builds(EncodedFrame, st.sampled_from(ImageType), st.binary(max_size=300))


@DETERMINISTIC
@given(st.lists(FRAMES, max_size=5), st.integers(1, 50), st.binary(max_size=4))
def test_frame_reader_in_any_segmentation_finds_the_frames(
    frames: list[EncodedFrame], size: int, tail: bytes
) -> None:
    data = b"".join(map(encode_frame, frames)) + tail
    reader = ImageFrameReader()
    found = [f for i in range(0, len(data), size) for f in reader.receive(data[i : i + size])]
    assert found == frames


def test_frame_reader_accepts_a_payload_at_the_limit() -> None:
    frame = EncodedFrame(ImageType.RAW, b"x" * 100)
    assert ImageFrameReader(max_payload_bytes=100).receive(encode_frame(frame)) == [frame]


def test_frame_reader_when_a_payload_is_too_large_raises_at_its_header() -> None:
    header = encode_frame_header(ImageType.RAW, MAX_IMAGE_PAYLOAD_BYTES + 1)
    reader = ImageFrameReader()
    assert reader.receive(header[:4]) == []
    with pytest.raises(RemoteProtocolError, match="the limit is"):
        reader.receive(header[4:])


def test_frame_reader_when_the_type_is_unknown_suggests_a_wrong_port() -> None:
    with pytest.raises(RemoteProtocolError, match="image port"):
        ImageFrameReader().receive(b"NFO {Gametype BotDeathMatch}\r\n")


def test_encoded_frame_when_logged_shows_type_and_size_only() -> None:
    assert str(EncodedFrame(ImageType.GOOD, b"x" * 5000)) == "GOOD frame of 5000 bytes"


def test_raw_header_when_packed_is_big_endian() -> None:
    assert encode_raw_header(640, 0x0102) == b"\x02\x80\x01\x02"


@pytest.mark.parametrize(("width", "height"), [(65536, 1), (1, 65536), (-1, 1)])
def test_raw_header_when_a_side_does_not_fit_raises(width: int, height: int) -> None:
    with pytest.raises(LocalProtocolError, match="does not fit"):
        encode_raw_header(width, height)


RAW = [
    (encode_raw_header(5, 2) + bytes(32), (5, 2, 16)),
    (encode_raw_header(5, 2) + bytes(30), (5, 2, 15)),
    *(
        (encode_raw_header(width, 2) + bytes(2 * pitch), (width, 2, pitch))
        for width, pitch in ((1, 4), (2, 8), (4, 12), (640, 1920))
    ),
    (encode_raw_header(0, 0), (0, 0, 0)),
]


@pytest.mark.parametrize(("payload", "size"), RAW)
def test_raw_size_when_rows_are_padded_or_not_finds_the_pitch(
    payload: bytes, size: tuple[int, int, int]
) -> None:
    assert parse_raw_size(payload) == size


@pytest.mark.parametrize(
    "payload", [b"", b"\0\1\0", encode_raw_header(5, 2) + bytes(31), b"\xff" * 4]
)
def test_raw_size_when_header_and_length_disagree_raises(payload: bytes) -> None:
    with pytest.raises(RemoteProtocolError, match="RAW frame"):
        parse_raw_size(payload)


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
