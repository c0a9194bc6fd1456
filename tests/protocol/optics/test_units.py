"""Unreal units: constants of UnitsConverter.uc."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.optics.units import metres_from_uu, radians_from_uu


def test_length_of_250_uu_is_a_metre() -> None:
    assert metres_from_uu(250.0) == 1.0


@pytest.mark.parametrize(
    ("angle_uu", "angle_rad"),
    [(16384.0, 0.5 * math.pi), (32768.0, math.pi), (-49152.0, -1.5 * math.pi), (0.0, 0.0)],
)
def test_angle_of_quarter_turns_is_exact(angle_uu: float, angle_rad: float) -> None:
    assert radians_from_uu(angle_uu) == pytest.approx(angle_rad, rel=1e-15)
