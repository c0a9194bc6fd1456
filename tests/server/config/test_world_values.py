"""Lengths, positions and colours of world files."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import parse_sections
from catoptra_server.config.world_file import read_colour, read_length, read_position


def make_section(*lines: str) -> SectionReader:
    (parsed,) = parse_sections("\n".join(("[A.B]", *lines)), file="x.ini")
    return SectionReader(parsed.name, parsed.where, parsed.entries)


def test_length_when_zero_is_rejected() -> None:
    with pytest.raises(ConfigError, match="from 1e-06 to 100000"):
        read_length(make_section("Radius=0"), "Radius")


def test_position_when_beyond_100_km_is_rejected() -> None:
    with pytest.raises(ConfigError, match="from -100000 to 100000"):
        read_position(make_section("Position=(X=1,Y=2e5)"), "Position")


def test_position_when_missing_is_its_default() -> None:
    assert read_position(make_section(), "Position", (1.0, 2.0, 3.0)) == (1.0, 2.0, 3.0)


def test_colour_when_read_is_linear() -> None:
    colour = read_colour(make_section("Colour=(R=255,G=188)"), "Colour", (0, 0, 0))
    # IEC 61966-2-1: byte 188 is half of the light.
    assert colour == pytest.approx((1.0, 0.503, 0.0), abs=1e-3)
