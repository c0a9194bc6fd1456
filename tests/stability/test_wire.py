"""Numbers on the wire, literally, and their units."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics import units
from catoptra_protocol.usarsim import value_format
from stability.catalogue import Case, check, load


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


@pytest.mark.parametrize("case", load("wire"), ids=str)
def test_number_when_hard_is_printed_and_read_to_the_letter(case: Case) -> None:
    check(case, SUBJECTS)
