"""Identities of ZeroMQ peers, in one piece and byte by byte."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.serve.stream.guard import IdentityFilter
from helpers.zmtp import COMMAND, GREETING, LONG, READY, zmtp_frame

MESSAGES = zmtp_frame(b"one") + zmtp_frame(b"\x08Identity")
TYPE = b"\x0bSocket-Type\0\0\0\x06DEALER"


def ready(*properties: bytes, flags: int = COMMAND) -> bytes:
    return zmtp_frame(b"\x05READY" + b"".join(properties), flags)


def identity(name: bytes) -> bytes:
    return bytes([len(name)]) + name + b"\0\0\0\x04same"


@pytest.mark.parametrize("piece_bytes", [1, 7, 10_000])
@pytest.mark.parametrize(
    ("sent", "passed"),
    [
        (READY, READY),
        (ready(TYPE, identity(b"Identity")), ready(TYPE, identity(b"X-Unused"))),
        (ready(identity(b"IDENTITY"), TYPE), ready(identity(b"X-Unused"), TYPE)),
        (
            ready(TYPE, identity(b"Identity"), flags=COMMAND | LONG),
            ready(TYPE, identity(b"X-Unused"), flags=COMMAND | LONG),
        ),
        (ready(identity(b"Identity2")), ready(identity(b"Identity2"))),
        (ready(b"\x08Identity\xff"), ready(b"\x08X-Unused\xff")),  # truncated
        (zmtp_frame(identity(b"Identity")), zmtp_frame(identity(b"Identity"))),  # no command
        (zmtp_frame(b"", COMMAND), zmtp_frame(b"", COMMAND)),
    ],
)
def test_identity_is_renamed_and_all_other_bytes_stay(
    sent: bytes, passed: bytes, piece_bytes: int
) -> None:
    data, stream = GREETING + sent + MESSAGES, IdentityFilter()
    pieces = [data[i : i + piece_bytes] for i in range(0, len(data), piece_bytes)]
    assert b"".join(map(stream.feed, pieces)) == GREETING + passed + MESSAGES


def test_greeting_is_passed_before_it_is_complete() -> None:
    stream = IdentityFilter()
    assert stream.feed(GREETING[:10]) == GREETING[:10]
    assert stream.feed(GREETING[10:] + READY[:5]) == GREETING[10:]


def test_ready_when_too_long_is_rejected() -> None:
    with pytest.raises(RemoteProtocolError, match="first command of 2009 bytes"):
        IdentityFilter().feed(GREETING + zmtp_frame(bytes(2000), COMMAND | LONG)[:20])
