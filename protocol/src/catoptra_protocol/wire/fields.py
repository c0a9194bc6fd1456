"""Read the fields of a server's message strictly: what is missing or wrong is named.

The counterpart of the lenient readers in `numbers`, for the client's side: a client that computes
with a reading must not compute with a zero that stands for garbage.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.wire.grammar import Message
from catoptra_protocol.wire.numbers import Vector, boolean_from_text

_SHOWN = 200  # characters of a bad line that an error quotes


def text(message: Message, name: str) -> str:
    """Return a field that must be there."""
    value = message.get(name)
    if value is None:
        raise RemoteProtocolError(f"{message.word} without {{{name}}}: {_shown(message)}")
    return value


def number(message: Message, name: str) -> float:
    """Return a finite number."""
    return _number(message, name, text(message, name))


def optional_number(message: Message, name: str) -> float | None:
    """Return a finite number; None where the field is missing."""
    return None if message.get(name) is None else number(message, name)


def integer(message: Message, name: str, default: int | None = None) -> int:
    """Return a whole number; the default, if there is one, where the field is missing."""
    if default is not None and message.get(name) is None:
        return default
    return int(number(message, name))


def numbers(message: Message, name: str) -> tuple[float, ...]:
    """Return finite numbers separated by commas, as many as there are."""
    parts = text(message, name).split(",")
    return tuple(_number(message, name, part) for part in parts)


def boolean(message: Message, name: str) -> bool:
    """Return a boolean; False where the field is missing."""
    return boolean_from_text(message.get(name) or "")


def vector(message: Message, name: str) -> Vector:
    """Return three finite numbers, separated by commas."""
    value = text(message, name)
    parts = value.split(",")
    if len(parts) != 3:
        raise _wrong(message, name, value, "three numbers x,y,z")
    x, y, z = (_number(message, name, part) for part in parts)
    return x, y, z


def vectors(message: Message, **values: str) -> tuple[Vector, ...]:
    """Return vectors that came without names of their own; the names given here are for errors."""
    named = Message(message.word, tuple(values.items()))
    return tuple(vector(named, name) for name in values)


def _number(message: Message, name: str, value: str) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _wrong(message, name, value, "a finite number")
    return number


def _wrong(message: Message, name: str, value: str, expected: str) -> RemoteProtocolError:
    return RemoteProtocolError(
        f"{message.word}: {{{name} {value[:_SHOWN]}}}: expected {expected}: {_shown(message)}"
    )


def _shown(message: Message) -> str:
    return str(message)[:_SHOWN]
