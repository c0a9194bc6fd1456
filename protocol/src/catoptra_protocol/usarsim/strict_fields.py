"""Strict readers of report fields: a missing or malformed field is an error that names the field.

The counterpart of `lenient_fields`, for the client's side: a client that computes with a reading
must not compute with a zero that stands for garbage. All readers raise RemoteProtocolError.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim.grammar import Message
from catoptra_protocol.usarsim.value_format import boolean_from_text
from catoptra_protocol.vectors import Vector3

# Characters of a malformed line in an error text.
_MAX_QUOTED_CHARS = 200


def read_text(message: Message, name: str) -> str:
    """Text of a required field."""
    value = message.get(name)
    if value is None:
        raise RemoteProtocolError(f"{message.word} without {{{name}}}: {_quote(message)}")
    return value


def read_number(message: Message, name: str) -> float:
    """Finite number of a required field."""
    return _parse_number(message, name, read_text(message, name))


def read_optional_number(message: Message, name: str) -> float | None:
    """Finite number; None if the field is missing."""
    return None if message.get(name) is None else read_number(message, name)


def read_integer(message: Message, name: str, default: int | None = None) -> int:
    """Integer; the default, if given, for a missing field."""
    if default is not None and message.get(name) is None:
        return default
    # Through a float: 4.0 is accepted as 4.
    return int(read_number(message, name))


def read_numbers(message: Message, name: str) -> tuple[float, ...]:
    """Finite numbers separated by commas, any count."""
    parts = read_text(message, name).split(",")
    # A scan has 181: all at once, and one by one only where one is wrong.
    try:
        numbers = tuple(map(float, parts))
    except ValueError:
        numbers = (math.nan,)
    if all(map(math.isfinite, numbers)):
        return numbers
    return tuple(_parse_number(message, name, part) for part in parts)


def read_boolean(message: Message, name: str) -> bool:
    """Boolean; False if the field is missing."""
    return boolean_from_text(message.get(name) or "")


def read_vector(message: Message, name: str) -> Vector3:
    """Three finite numbers separated by commas."""
    value = read_text(message, name)
    parts = value.split(",")
    if len(parts) != 3:
        raise _field_error(message, name, value, "three numbers x,y,z")
    x, y, z = (_parse_number(message, name, part) for part in parts)
    return x, y, z


def parse_vectors(message: Message, **values: str) -> tuple[Vector3, ...]:
    """Vectors from texts outside named blocks; the keywords are the names in error texts."""
    fields = Message(message.word, tuple(values.items()))
    return tuple(read_vector(fields, name) for name in values)


def _parse_number(message: Message, name: str, value: str) -> float:
    # Not number_from_text, which would turn a malformed reading into 0.
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise _field_error(message, name, value, "a finite number")
    return number


def _field_error(message: Message, name: str, value: str, expected: str) -> RemoteProtocolError:
    return RemoteProtocolError(
        f"{message.word}: {{{name} {value[:_MAX_QUOTED_CHARS]}}}: "
        f"expected {expected}: {_quote(message)}"
    )


def _quote(message: Message) -> str:
    return str(message)[:_MAX_QUOTED_CHARS]
