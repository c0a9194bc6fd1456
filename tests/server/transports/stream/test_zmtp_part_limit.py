"""Bytes of ZeroMQ peers, in one piece and byte by byte: only endless messages raise."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_server.serve.stream.guard import MAX_PARTS, ZmtpPartCounter
from helpers.zmtp import COMMAND, GREETING, LONG, MORE, READY, zmtp_frame

PART = zmtp_frame(b"part", MORE)
LAST = zmtp_frame(b"last")
PING = zmtp_frame(b"\x04PING\0\0", COMMAND)

VALID = {
    "a message": LAST,
    "empty messages": 100 * zmtp_frame(b""),
    "the maximum of parts": (MAX_PARTS - 1) * PART + LAST,
    "many messages of several parts": 100 * (PART + PART + LAST),
    "long lengths": 100 * (zmtp_frame(bytes(300), LONG | MORE) + zmtp_frame(b"", LONG)),
    "a body that looks like parts": zmtp_frame(PART * 20, LONG),
    "commands between parts": 3 * (PART + PING) + LAST,
    "many commands": 100 * PING,
}
INVALID = {
    "more than the maximum of parts": MAX_PARTS * PART,
    "empty parts": MAX_PARTS * zmtp_frame(b"", MORE),
    "long parts": MAX_PARTS * zmtp_frame(bytes(300), LONG | MORE),
    "parts hidden behind commands": MAX_PARTS * (PING + PART),
    "parts after good messages": 5 * (PART + LAST) + MAX_PARTS * PART,
    "a command with more": zmtp_frame(b"\x04PING\0\0", COMMAND | MORE),
}
PIECES = {"one piece": 10_000_000, "by 7 bytes": 7, "byte by byte": 1}


def feed_pieces(data: bytes, piece_bytes: int) -> None:
    counter = ZmtpPartCounter()
    for start in range(0, len(data), piece_bytes):
        counter.feed(data[start : start + piece_bytes])


@pytest.mark.parametrize("piece_bytes", PIECES.values(), ids=PIECES)
@pytest.mark.parametrize("messages", VALID.values(), ids=VALID)
def test_messages_when_they_end_pass(messages: bytes, piece_bytes: int) -> None:
    feed_pieces(GREETING + READY + messages, piece_bytes)


@pytest.mark.parametrize("piece_bytes", PIECES.values(), ids=PIECES)
@pytest.mark.parametrize("messages", INVALID.values(), ids=INVALID)
def test_message_when_it_has_too_many_parts_raises(messages: bytes, piece_bytes: int) -> None:
    with pytest.raises(RemoteProtocolError, match="parts"):
        feed_pieces(GREETING + READY + messages, piece_bytes)


def test_message_when_it_has_too_many_parts_raises_before_its_bytes_are_passed() -> None:
    counter = ZmtpPartCounter()
    counter.feed(GREETING + READY + (MAX_PARTS - 1) * PART)
    with pytest.raises(RemoteProtocolError, match="more than 8 parts"):
        counter.feed(PART[:2])


OTHER_GREETINGS = {
    "no ZeroMQ": b"INIT {ClassName USARBot.P2AT}\r\n".ljust(64),
    "a short first part of ZMTP 1": b"\xff" + bytes(63),
    "ZMTP 2": b"\xff" + bytes(8) + b"\x7f\x01" + bytes(53),
}


@pytest.mark.parametrize("greeting", OTHER_GREETINGS.values(), ids=OTHER_GREETINGS)
def test_greeting_when_not_of_zmtp_3_raises(greeting: bytes) -> None:
    with pytest.raises(RemoteProtocolError, match="no greeting of ZMTP 3"):
        feed_pieces(greeting, 64)


@pytest.mark.parametrize("piece_bytes", PIECES.values(), ids=PIECES)
@pytest.mark.parametrize(
    ("data", "num_messages", "num_parts"),
    [
        (b"", 0, 1),
        (PING, 0, 2),
        (PART + PING, 0, 3),
        (PART + LAST, 1, 3),
        (LAST[:-1], 0, 2),
        (3 * zmtp_frame(b""), 3, 4),
        (zmtp_frame(bytes(300), LONG) + LAST, 2, 3),
    ],
)
def test_messages_are_counted_when_they_are_complete(
    data: bytes, num_messages: int, num_parts: int, piece_bytes: int
) -> None:
    counter = ZmtpPartCounter()
    whole = GREETING + READY + data
    for start in range(0, len(whole), piece_bytes):
        counter.feed(whole[start : start + piece_bytes])
    assert (counter.num_messages, counter.num_parts) == (num_messages, num_parts)
