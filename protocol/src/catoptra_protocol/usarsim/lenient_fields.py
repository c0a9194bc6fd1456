"""Read the fields of a client's command leniently, and write them: for the commands only.

The counterpart of `fields`: what a client left out or wrote badly becomes None, 0 or an empty text.
"""

from __future__ import annotations

from catoptra_protocol.limits import MAX_NAME_CHARS
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.value_format import (
    Vector3,
    boolean_from_text,
    format_exact,
    number_from_text,
    vector_from_text,
)


def read_name(message: Message, key: str) -> str | None:
    """Return a name short enough to be echoed; None if it is missing or empty."""
    return (message.get(key) or "")[:MAX_NAME_CHARS] or None


def read_number(message: Message, key: str) -> float | None:
    """Return a finite number; None if it is missing."""
    text = message.get(key)
    return None if text is None else number_from_text(text)


def read_integer(message: Message, key: str) -> int | None:
    """Return the whole part of a number; None if it is missing."""
    value = read_number(message, key)
    return None if value is None else int(value)


def read_boolean(message: Message, key: str) -> bool | None:
    """Return a boolean; None if it is missing."""
    text = message.get(key)
    return None if text is None else boolean_from_text(text)


def read_vector(message: Message, key: str) -> Vector3 | None:
    """Return three numbers; None if they are missing."""
    text = message.get(key)
    return None if text is None else vector_from_text(text)


def format_pairs(*pairs: tuple[str, str | float | bool | Vector3 | None]) -> Pairs:
    """Return the blocks of what is not None: numbers exact, booleans as UDK compares them."""
    return tuple((key, _format_value(value)) for key, value in pairs if value is not None)


def _format_value(value: str | float | bool | Vector3) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return ",".join(map(format_exact, value))
    return str(value) if isinstance(value, int) else format_exact(value)
