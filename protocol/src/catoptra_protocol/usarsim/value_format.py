"""Printing and parsing of numbers, vectors and booleans as in USARSim.

Output: fixed point, truncated, never an exponent (FloatString of UnrealScript). Input: total, as in
UnrealScript: a text that is no number is 0. Source: captures of USARSim; SPEC.md 3.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable
from decimal import Decimal

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.vectors import Vector3

# The prefix that C's atof, behind float(text) of UnrealScript, accepts; without inf and nan.
# Each part begins with another character: one way to match the digits, and a linear time.
_NUMBER = re.compile(r" *([+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)")
# Longer than the longest double without an exponent; float() of 64 000 digits takes 8 ms.
_MAX_NUMBER_CHARS = 1100
# Numbers of one setting: more than any has. Of a line of 64 kB, all would take 27 ms.
_MAX_NUMBERS = 16
_SEPARATOR = re.compile(r" *, *| +")
# The rounded constant of UnitsConverter.uc: 65536 / (2 pi) would truncate other angles.
_UU_PER_RADIAN = 10430.3783505


def format_exact(value: float) -> str:
    """Shortest decimal that reads back as this double, without an exponent.

    Raises:
        LocalProtocolError: The number is not finite.
    """
    if not math.isfinite(value):
        raise LocalProtocolError(f"{value!r} cannot be sent: only finite numbers can")
    text = repr(float(value))
    # repr has an exponent below 1e-4 and from 1e16 on, which atof of some clients does not read.
    return format(Decimal(text), "f") if "e" in text else text


def format_fixed_point(value: float, decimals: int = 4) -> str:
    """Number with this many decimals, truncated towards zero: pi is 3.1415.

    The truncated text is the shortest decimal that denotes the double, not its binary expansion: a
    configured 5.385 prints 5.3850 as in the replies of the reference, though the double nearest to
    it is 5.38499999999999978. Negative zero prints as -0.0000, as on the real wire.
    """
    # On the text: int(value * 10**decimals) would print 5.3849 for 5.385.
    whole, _, fraction = format_exact(value).partition(".")
    return f"{whole}.{fraction[:decimals].ljust(decimals, '0')}" if decimals else whole


def truncate_to_unreal_units(angle_rad: float) -> float:
    """Angle as UDK stores it: truncated to whole Unreal units, 65536 to a turn.

    A configured 3.14159 rad is 32767 units and prints 3.1414. Source: UnitsConverter.uc.

    Raises:
        LocalProtocolError: The angle is not finite in Unreal units.
    """
    units = angle_rad * _UU_PER_RADIAN
    if not math.isfinite(units):
        raise LocalProtocolError(f"an angle of {angle_rad!r} rad cannot be sent in Unreal units")
    return math.trunc(units) / _UU_PER_RADIAN


def format_vector(values: Iterable[float], decimals: int = 4) -> str:
    """Numbers joined by commas, without spaces."""
    return ",".join(format_fixed_point(value, decimals) for value in values)


def format_rounded_vector(values: Iterable[float]) -> str:
    """Numbers with 2 decimals, rounded as in a string conversion of UnrealScript: 0.2085 is 0.21.

    Raises:
        LocalProtocolError: A number is not finite.
    """
    # Of the shortest decimal, as in format_fixed_point; format_exact refuses what is not finite.
    return ",".join(f"{Decimal(format_exact(value)):.2f}" for value in values)


def format_boolean(value: bool) -> str:
    """True or False, as servers print booleans."""
    return "True" if value else "False"


def number_from_text(text: str) -> float:
    """Number at the start of the text, or 0: always finite."""
    found = _NUMBER.match(text, 0, _MAX_NUMBER_CHARS)
    value = float(found.group(1)) if found else 0.0
    # An overflow such as 1e999 is the largest double: still beyond every limit of a command.
    return value if math.isfinite(value) else math.copysign(sys.float_info.max, value)


def is_number(text: str) -> bool:
    """Whether the whole text is a finite number."""
    found = _NUMBER.fullmatch(text)
    return found is not None and math.isfinite(float(found.group(1)))


def vector_from_text(text: str) -> Vector3:
    """Three numbers separated by a comma, a comma and spaces, or spaces.

    Missing ones are 0, further ones are ignored.
    """
    numbers = [number_from_text(part) for part in _SEPARATOR.split(text.strip(" "), maxsplit=3)]
    x, y, z = (*numbers, 0.0, 0.0, 0.0)[:3]
    return x, y, z


def numbers_from_text(text: str) -> tuple[float, ...]:
    """Numbers of a text, separated as those of a vector; none of an empty text.

    Of more than 16 numbers the first 17 are returned, too many for any setting.
    """
    parts = _SEPARATOR.split(text.strip(" "), maxsplit=_MAX_NUMBERS)
    return () if parts == [""] else tuple(number_from_text(part) for part in parts)


def boolean_from_text(text: str) -> bool:
    """Whether the text is `true`, in any case, or a number other than 0."""
    return text.strip(" ").lower() == "true" or number_from_text(text) != 0.0
