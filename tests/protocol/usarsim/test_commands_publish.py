"""NOTE and SHARE: round trips, and the lines that are none."""

from __future__ import annotations

import base64

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_LINE_BYTES, MAX_NOTE_BYTES
from catoptra_protocol.usarsim.commands import (
    Command,
    Note,
    ShareControl,
    command_from_message,
    line_from_command,
)
from catoptra_protocol.usarsim.grammar import LineReader, parse_message

# Braces, line ends and letters beyond Latin-1, none of which a block could hold.
TEXT = '{"text": "{\u03c3}", "pose": [1.0,\r\n2.0]}'


def decode(line: bytes) -> Command | None:
    (text,) = LineReader().receive(line)
    return command_from_message(parse_message(text))


def line_with_data(data: bytes, name: str = "a") -> bytes:
    return b"NOTE {Name %s} {Data %s}\r\n" % (name.encode("latin-1"), base64.b64encode(data))


@pytest.mark.parametrize(
    "command", [Note("my filter", TEXT), ShareControl(True), ShareControl(False)], ids=repr
)
def test_command_when_written_and_read_is_equal(command: Command) -> None:
    assert decode(line_from_command(command)) == command


def test_note_when_as_long_as_allowed_fits_into_a_line() -> None:
    note = Note("n" * 64, '{"x":"' + (MAX_NOTE_BYTES - 8) * "y" + '"}')
    line = line_from_command(note)
    assert len(line) < MAX_LINE_BYTES
    assert decode(line) == note


MALFORMED = {
    "no name": b"NOTE {Data e30=}\r\n",
    "no data": b"NOTE {Name a}\r\n",
    "a character outside of Base64": b"NOTE {Name a} {Data e3!0=}\r\n",
    "no padding": b"NOTE {Name a} {Data e30}\r\n",
    "no UTF-8": line_with_data(b'{"x":"\xff"}'),
    "an encoded surrogate": line_with_data(b'{"x":"\xed\xa0\x80"}'),
    "an escaped surrogate": line_with_data(rb'{"x":"\ud800"}'),
    "no object": line_with_data(b"[1]"),
    "NaN": line_with_data(b'{"x":NaN}'),
    "giant": line_with_data(b'{"x":"' + MAX_NOTE_BYTES * b"y" + b'"}'),
    "deep": line_with_data(b'{"x":' + 4000 * b"[" + 4000 * b"]" + b"}"),
    "a control character in the name": line_with_data(b"{}", "a\x9b"),
    "a long name": line_with_data(b"{}", "a" * 65),
}


@pytest.mark.parametrize("line", MALFORMED.values(), ids=MALFORMED.keys())
def test_line_when_no_note_is_ignored(line: bytes) -> None:
    assert decode(line) is None


@pytest.mark.parametrize(
    "note", [Note("", "{}"), Note("a\r\nDRIVE", "{}"), Note("a}", "{}"), Note("a", "[]")], ids=repr
)
def test_note_when_none_is_not_sent(note: Note) -> None:
    with pytest.raises(LocalProtocolError, match="NOTE"):
        line_from_command(note)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.binary(max_size=40))
def test_any_data_is_a_note_or_ignored(data: bytes) -> None:
    command = decode(line_with_data(data))
    assert command is None or isinstance(command, Note)
