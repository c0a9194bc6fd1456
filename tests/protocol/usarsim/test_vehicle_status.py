"""STA in both dialects; the captures are conformance vectors."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.reports import VehicleStatus, line_from_report


@pytest.mark.parametrize("dialect", Dialect)
def test_status_when_written_and_read_is_the_same(dialect: Dialect) -> None:
    joints = (("FRFlipper", -0.5), ("Arm", 1.25))
    status = VehicleStatus(12.25, 1188, light=True, joints=joints)
    line = line_from_report(status, dialect).decode().rstrip()
    assert VehicleStatus.from_message(parse_message(line)) == status


def test_status_skips_a_further_field_that_is_no_number() -> None:
    line = "STA {Type GroundVehicle} {Time 1.00} {Battery 9} {Mood bright} {Odd 1x} {Tail .5}"
    assert VehicleStatus.from_message(parse_message(line)).joints == (("Tail", 0.5),)


def test_view_is_written_in_ut2004_only() -> None:
    ut2004, udk = (line_from_report(VehicleStatus(1.0, 9, view=2), d) for d in Dialect)
    assert ut2004.endswith(b"{View 2}\r\n")
    assert b"View" not in udk


def test_intensity_when_the_light_is_off_is_0_in_ut2004_and_100_in_udk() -> None:
    ut2004, udk = (line_from_report(VehicleStatus(1.0, 9), d) for d in Dialect)
    assert b"{LightIntensity 0}" in ut2004
    assert b"{LightIntensity 100}" in udk
