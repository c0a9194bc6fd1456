"""Lenient readers and the writer of command fields.

The counterpart of `strict_fields`, for the server's side: a missing field is None, a malformed one
0 or an empty text, since the protocol has no message for a malformed command.
"""

from __future__ import annotations

from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.value_format import (
    boolean_from_text,
    format_exact,
    number_from_text,
    vector_from_text,
)
from catoptra_protocol.vectors import Vector3


def read_name(message: Message, key: str) -> str | None:
    """Name truncated to a length that fits into a reply; None if missing or empty."""
    # Names are echoed in replies, whose lines have a limited length.
    return (message.get(key) or "")[:MAX_NAME_CHARS] or None


def read_number(message: Message, key: str) -> float | None:
    """Finite number; None if missing."""
    text = message.get(key)
    return None if text is None else number_from_text(text)


def read_integer(message: Message, key: str) -> int | None:
    """Number truncated to an integer; None if missing."""
    value = read_number(message, key)
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
