"""Lenient readers and the writer of command fields.

The counterpart of `strict_fields`, for the server's side: a missing field is None, a malformed one
0 or an empty text, since the protocol has no message for a malformed command. Only a set point
beyond all limits is an error, for which the command is ignored.
"""

from __future__ import annotations

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.limits import MAX_COMMAND_NUMBER, MAX_NAME_CHARS
from catoptra_protocol.usarsim.grammar import CONTROL_CHARACTERS, Message, Pairs
from catoptra_protocol.usarsim.value_format import (
    boolean_from_text,
    format_exact,
    number_from_text,
    vector_from_text,
)
from catoptra_protocol.vectors import Vector3


def read_name(message: Message, key: str) -> str | None:
    """Printable name, of a length that fits into a reply; None if missing or empty."""
    return printable_name(message.get(key) or "") or None


def printable_name(text: str) -> str:
    """Name truncated to MAX_NAME_CHARS, with `?` in place of each control character."""
    # Names are echoed: in replies, whose lines have a limited length, in logs and on terminals.
    return CONTROL_CHARACTERS.sub("?", text[:MAX_NAME_CHARS])


def read_text(message: Message, key: str) -> str | None:
    """Text of any length, with `?` in place of each control character; None if missing."""
    text = message.get(key)
    return None if text is None else CONTROL_CHARACTERS.sub("?", text)


def read_number(message: Message, key: str) -> float | None:
    """Finite number; None if missing."""
    text = message.get(key)
    return None if text is None else number_from_text(text)


def read_set_point(message: Message, key: str) -> float | None:
    """Number that a motion command sets; None if missing.

    Raises:
        RemoteProtocolError: The number exceeds MAX_COMMAND_NUMBER.
    """
    text = message.get(key)
    return None if text is None else set_point_from_text(text)


def set_point_from_text(text: str) -> float:
    """Number that a motion command sets, or 0.

    Raises:
        RemoteProtocolError: The number exceeds MAX_COMMAND_NUMBER.
    """
    value = number_from_text(text)
    if abs(value) > MAX_COMMAND_NUMBER:
        raise RemoteProtocolError(
            f"{value:g} in a motion command: the limit is +-{MAX_COMMAND_NUMBER:g}"
        )
    return value


def read_integer(message: Message, key: str) -> int | None:
    """Set point truncated to an integer; None if missing.

    Raises:
        RemoteProtocolError: The number exceeds MAX_COMMAND_NUMBER.
    """
    value = read_set_point(message, key)
    return None if value is None else int(value)


def read_boolean(message: Message, key: str) -> bool | None:
    """Boolean; None if missing."""
    text = message.get(key)
    return None if text is None else boolean_from_text(text)


def read_vector(message: Message, key: str) -> Vector3 | None:
    """Three numbers; None if missing."""
    text = message.get(key)
    return None if text is None else vector_from_text(text)


def format_pairs(*pairs: tuple[str, str | float | bool | Vector3 | None]) -> Pairs:
    """Pairs of the values that are not None: numbers exact, booleans in lower case for UDK."""
    # None means no block: servers distinguish a missing value from 0.
    return tuple((key, _format_value(value)) for key, value in pairs if value is not None)


def _format_value(value: str | float | bool | Vector3) -> str:
    if isinstance(value, str):
        return value
    # Before the numbers: bool is a subclass of int.
    if isinstance(value, bool):
        # UDK compares with `true` exactly (SPEC-NOTES.md, 3).
        return str(value).lower()
    if isinstance(value, tuple):
        return ",".join(map(format_exact, value))
    return str(value) if isinstance(value, int) else format_exact(value)
