"""Numbers, vectors and booleans as USARSim prints and reads them.

Output: fixed point, truncated, never an exponent (UnrealScript's FloatString). Input: total, as
UnrealScript is: what is no number is 0. Source: usarsim captures, SPEC.md 4.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from decimal import Decimal

from catoptra_protocol.errors import LocalProtocolError

Vector3 = tuple[float, float, float]

# What C's atof, behind UnrealScript's float(text), takes from the start of a text; no inf, no nan.
_NUMBER = re.compile(r" *([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)")
_SEPARATOR = re.compile(r" *, *| +")
_UU_PER_RADIAN = 10430.3783505  # the constant of UnitsConverter.uc


def format_exact(value: float) -> str:
    """Return the shortest decimal that reads back as this double, without an exponent."""
    if not math.isfinite(value):
        raise LocalProtocolError(f"{value!r} cannot be sent: only finite numbers can")
    text = repr(float(value))
    return format(Decimal(text), "f") if "e" in text else text


def format_fixed_point(value: float, decimals: int = 4) -> str:
    """Return the number with so many decimals, truncated towards zero: pi is 3.1415.

    What is truncated is the shortest decimal that denotes the double, not its binary expansion: a
    configured 5.385 prints 5.3850 as in the reference's replies, though the double nearest to it
    is 5.38499999999999978. Negative zero prints as -0.0000, as on the real wire.
    """
    whole, _, fraction = format_exact(value).partition(".")
    return f"{whole}.{fraction[:decimals].ljust(decimals, '0')}" if decimals else whole


def truncate_to_unreal_units(angle_rad: float) -> float:
    """Return the angle as UDK keeps it: truncated to whole Unreal units, 65536 to a turn.

    A configured 3.14159 rad is 32767 units and prints 3.1414. Source: UnitsConverter.uc.
    """
    units = angle_rad * _UU_PER_RADIAN
    if not math.isfinite(units):
        raise LocalProtocolError(f"an angle of {angle_rad!r} rad cannot be sent in Unreal units")
    return math.trunc(units) / _UU_PER_RADIAN


def format_vector(values: Iterable[float], decimals: int = 4) -> str:
    """Return the numbers joined by commas, without spaces."""
    return ",".join(format_fixed_point(value, decimals) for value in values)


def format_boolean(value: bool) -> str:
    """Return True or False, as the server prints them."""
    return "True" if value else "False"


def number_from_text(text: str) -> float:
    """Return the number that the text starts with, or 0: always finite."""
    found = _NUMBER.match(text)
    value = float(found.group(1)) if found else 0.0
    return value if math.isfinite(value) else 0.0


def is_number(text: str) -> bool:
    """Return whether the whole text is a finite number."""
    found = _NUMBER.fullmatch(text)
    return found is not None and math.isfinite(float(found.group(1)))


def vector_from_text(text: str) -> Vector3:
    """Return three numbers separated by a comma, a comma and spaces, or spaces.

    Missing ones are 0, further ones are ignored.
    """
    numbers = [number_from_text(part) for part in _SEPARATOR.split(text.strip(" "), maxsplit=3)]
    x, y, z = (*numbers, 0.0, 0.0, 0.0)[:3]
    return x, y, z


def numbers_from_text(text: str) -> tuple[float, ...]:
    """Return all numbers of a text, separated as those of a vector; none of an empty one."""
    parts = _SEPARATOR.split(text.strip(" "))
    return () if parts == [""] else tuple(number_from_text(part) for part in parts)


def boolean_from_text(text: str) -> bool:
    """Return whether the text is `true`, in any case, or a number other than 0."""
    return text.strip(" ").lower() == "true" or number_from_text(text) != 0.0
