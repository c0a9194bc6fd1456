"""Degrees and minutes: hemispheres, seams and limits."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.readings import GpsReading, reading_from_message
from catoptra_protocol.usarsim.reports import line_from_report

PLACES = [
    (0.0, 0.0, "{Latitude 0,0.0000,N} {Longitude 0,0.0000,E}"),
    (-0.5, -180.0, "{Latitude 0,30.0000,S} {Longitude 180,0.0000,W}"),
    (52.0 - 1e-9, 4.99999999999, "{Latitude 51,59.9999,N} {Longitude 4,59.9999,E}"),
    (52.35567, 4.95413, "{Latitude 52,21.3402,N} {Longitude 4,57.2478,E}"),
]


@pytest.mark.parametrize(("latitude", "longitude", "place"), PLACES)
def test_position_when_written_has_truncated_minutes(
    latitude: float, longitude: float, place: str
) -> None:
    line = line_from_report(GpsReading("G", latitude, longitude, True, 8)).decode()
    assert line == f"SEN {{Type GPS}} {{Name G}} {place} {{Fix 1}} {{Satellites 8}}\r\n"


ANGLES = st.integers(-180 * 600_000, 180 * 600_000).map(lambda units: units / 600_000)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(ANGLES, ANGLES)
def test_position_when_read_and_written_prints_unchanged(latitude: float, longitude: float) -> None:
    line = line_from_report(GpsReading("G", latitude, longitude, True, 8))
    reading = reading_from_message(parse_message(line.decode().rstrip()))
    assert isinstance(reading, GpsReading)
    # The printed place is 1e-4 minutes; what is read back is that to a double's noise.
    assert (reading.latitude_deg, reading.longitude_deg) == pytest.approx(
        (latitude, longitude), rel=0, abs=1e-9
    )
    assert line_from_report(reading) == line


@pytest.mark.parametrize("angle_deg", [180.1, -1e300, float("inf"), float("nan")])
def test_position_beyond_180_degrees_is_rejected(angle_deg: float) -> None:
    with pytest.raises(LocalProtocolError, match="GPS"):
        line_from_report(GpsReading("G", 0.0, angle_deg, True, 8))


BAD = [
    ("{Latitude 39,8.0,N} {Fix 1} {Satellites 3}", "without {Longitude}"),
    ("{Latitude 39,8.0} {Longitude 1,2,E} {Fix 1} {Satellites 3}", "degrees,minutes,side"),
    ("{Latitude 39,8.0,X} {Longitude 1,2,E} {Fix 1} {Satellites 3}", "one of N, S"),
    ("{Latitude 999,8.0,N} {Longitude 1,2,E} {Fix 1} {Satellites 3}", "at most 180"),
    ("{Latitude a,8.0,N} {Longitude 1,2,E} {Fix 1} {Satellites 3}", "Latitude a"),
    ("{Fix 0}", "without {Satellites}"),
]


@pytest.mark.parametrize(("fields", "field_name"), BAD)
def test_position_when_malformed_names_the_field(fields: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        reading_from_message(parse_message(f"SEN {{Type GPS}} {{Name G}} {fields}"))
