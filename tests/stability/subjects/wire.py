"""Numbers on the wire, literally, and their units."""

from __future__ import annotations

from catoptra_protocol.usarsim import value_format
from catoptra_server.config import camera_sections as units


def _format(value: float, decimals: int, text: str) -> float:
    printed = value_format.format_fixed_point(value, decimals)
    assert printed == text, f"{value!r} is printed as {printed}, not as {text}"
    return float(printed)


def _read(text: str) -> float:
    return value_format.number_from_text(text)


def _angle(angle_rad: float) -> float:
    return value_format.truncate_to_unreal_units(angle_rad)


def _length(length_uu: float) -> float:
    return units.metres_from_uu(length_uu)


SUBJECTS = {
    "fixed": _format,
    "number_from_text": _read,
    "unreal_angle": _angle,
    "metres_from_uu": _length,
}
