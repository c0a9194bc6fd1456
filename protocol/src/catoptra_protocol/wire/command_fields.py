"""Read the fields of a client's command leniently, and write them: for the commands only.

The counterpart of `fields`: what a client left out or wrote badly becomes None, 0 or an empty text.
"""

from __future__ import annotations

from catoptra_protocol.wire.grammar import Message, Pairs
from catoptra_protocol.wire.limits import MAX_NAME_CHARS
from catoptra_protocol.wire.numbers import (
    Vector,
    boolean_from_text,
    exact,
    number_from_text,
    vector_from_text,
)


def name(message: Message, key: str) -> str | None:
    """Return a name short enough to be echoed; None if it is missing or empty."""
    return (message.get(key) or "")[:MAX_NAME_CHARS] or None


def number(message: Message, key: str) -> float | None:
    """Return a finite number; None if it is missing."""
    text = message.get(key)
    return None if text is None else number_from_text(text)


def integer(message: Message, key: str) -> int | None:
    """Return the whole part of a number; None if it is missing."""
    value = number(message, key)
    return None if value is None else int(value)


def boolean(message: Message, key: str) -> bool | None:
    """Return a boolean; None if it is missing."""
    text = message.get(key)
    return None if text is None else boolean_from_text(text)


def vector(message: Message, key: str) -> Vector | None:
    """Return three numbers; None if they are missing."""
    text = message.get(key)
    return None if text is None else vector_from_text(text)


def given(*pairs: tuple[str, str | float | bool | Vector | None]) -> Pairs:
    """Return the blocks of what is not None: numbers exact, booleans as UDK compares them."""
    return tuple((key, _text(value)) for key, value in pairs if value is not None)


def _text(value: str | float | bool | Vector) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return ",".join(map(exact, value))
    return str(value) if isinstance(value, int) else exact(value)
