"""The msgpack codec: oversized and malformed messages are rejected before allocation."""

from __future__ import annotations

import contextlib
import dataclasses
import math

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.stream.codec import pack, unpack
from helpers.stream_messages import HEADER

LIMIT = 1000


MALFORMED = {
    "nothing": b"",
    "cut": b"\x81\xa1",
    "a list": b"\x90",
    "two objects": b"\x80\x80",
    "never used byte": b"\xc1",
    "no utf-8": b"\x81\xa1\xff\x01",
    "length of a huge map": b"\xdf\xff\xff\xff\xff",
    "length of a huge list": b"\x81\xa1a\xdd\xff\xff\xff\xff",
    "length of a huge str": b"\x81\xa1a\xdb\xff\xff\xff\xff",
    "binary": b"\x81\xa1a\xc4\x01a",
    "an extension": b"\x81\xa1a\xd4\x01a",
    "a timestamp": b"\x81\xa1a\xd6\xff\0\0\0\0",
    "nested without end": b"\x91" * 900,
    "a list as key": b"\x81\x90\x01",
}


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED.keys())
def test_bytes_when_not_a_map_within_limits_are_rejected(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        unpack(data, LIMIT)


def test_bytes_when_too_many_are_rejected_undecoded() -> None:
    with pytest.raises(RemoteProtocolError, match="1001 bytes: at most 1000"):
        unpack(bytes(LIMIT + 1), LIMIT)


def test_number_when_not_finite_is_not_sent() -> None:
    with pytest.raises(LocalProtocolError, match=r"FrameHeader\.age_s"):
        pack("frame", dataclasses.replace(HEADER, age_s=math.inf))


@given(st.binary(max_size=60))
def test_any_bytes_are_decoded_or_rejected(data: bytes) -> None:
    with contextlib.suppress(RemoteProtocolError):
        assert isinstance(unpack(data, LIMIT), dict)


def test_fields_when_packed_begin_with_the_kind() -> None:
    assert next(iter(msgpack.unpackb(pack("frame", HEADER)).items())) == ("kind", "frame")
