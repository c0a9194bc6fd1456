"""ZMTP messages of the mutation proxy in any segmentation."""

from __future__ import annotations

import pytest

from conformance.stream_zmtp import (
    ZmtpSplitter,
    is_command,
    message_from_parts,
    parts_from_message,
)
from helpers.zmtp import GREETING, MORE, READY, zmtp_frame

SHORT = zmtp_frame(b"head", MORE) + zmtp_frame(b"")
LONG_MESSAGE = message_from_parts([b"head", bytes(300)])
STREAM = GREETING + READY + SHORT + LONG_MESSAGE


@pytest.mark.parametrize("size", [1, 2, 7, 11, 100, 1000])
def test_messages_in_any_pieces_are_whole_and_nothing_is_lost(size: int) -> None:
    splitter, rest, found = ZmtpSplitter(), b"", []
    for start in range(0, len(STREAM), size):
        messages, rest = splitter(rest + STREAM[start : start + size])
        found += messages
    assert rest == b""
    assert b"".join(found) == STREAM
    assert found[-3:] == [READY, SHORT, LONG_MESSAGE]


def test_greeting_when_a_part_of_it_arrives_passes_at_once() -> None:
    assert ZmtpSplitter()(GREETING[:10]) == ([GREETING[:10]], b"")


def test_parts_when_packed_are_read_back() -> None:
    assert parts_from_message(SHORT) == [b"head", b""]
    assert parts_from_message(LONG_MESSAGE) == [b"head", bytes(300)]
    assert is_command(READY)
    assert not is_command(SHORT)
