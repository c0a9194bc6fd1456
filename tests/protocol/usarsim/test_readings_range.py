"""Range scans and sonars: length, decimals, and malformed lines."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_SERVER_LINE_BYTES
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.readings import RangeScanReading, SonarReadings, reading_from_message
from catoptra_protocol.usarsim.reports import line_from_report

RANGES = st.lists(st.floats(0.0, 80.0), min_size=1, max_size=181).map(tuple)


def make_scan(ranges_m: tuple[float, ...]) -> RangeScanReading:
    return RangeScanReading(395.3833, "Scanner1", 0.01745, math.pi, ranges_m)


@pytest.mark.parametrize("dialect", Dialect)
def test_scan_of_181_beams_fits_into_a_client_s_buffer(dialect: Dialect) -> None:
    line = line_from_report(make_scan((79.98765,) * 181), dialect)
    assert len(line) < MAX_SERVER_LINE_BYTES // 2


def test_scan_with_too_many_beams_is_rejected() -> None:
    with pytest.raises(LocalProtocolError, match="fewer items"):
        line_from_report(make_scan((1.0,) * 1000))


def test_sonars_when_sixteen_share_one_line() -> None:
    names = [f"{side}{i}" for side in "FR" for i in range(1, 9)]
    line = line_from_report(SonarReadings(1.0, tuple((name, 5.0) for name in names)))
    assert line.count(b"\r\n") == 1
    assert line.count(b"} {") == 17


@settings(derandomize=True, max_examples=50, deadline=None)
@given(RANGES, st.sampled_from(Dialect))
def test_scan_when_written_and_read_loses_less_than_its_last_decimal(
    ranges_m: tuple[float, ...], dialect: Dialect
) -> None:
    line = line_from_report(make_scan(ranges_m), dialect).decode()
    reading = reading_from_message(parse_message(line.rstrip()))
    assert isinstance(reading, RangeScanReading)
    last_place_m = 1e-4 if dialect is Dialect.UT2004 else 1e-2
    assert reading.ranges_m == pytest.approx(ranges_m, rel=0, abs=1.0001 * last_place_m)


BAD = [
    ("SEN {Type RangeScanner} {Name S}", "without {Time}"),
    ("SEN {Time 1} {Type RangeScanner} {Name S} {Resolution 1} {FOV 2}", "without {Range}"),
    ("SEN {Time 1} {Type RangeScanner} {Name S} {Resolution 1} {FOV 2} {Range 1,x}", "Range x"),
    ("SEN {Time 1} {Type Sonar} {Name F1}", "without {Range}"),
    ("SEN {Time 1} {Type Sonar} {Name F1 Range}", "without {Range}"),
    ("SEN {Time 1} {Type Sonar} {Name F1 Range far}", "Range far"),
    ("SEN {Type Sonar} {Name F1 Range 1}", "without {Time}"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_range_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        reading_from_message(parse_message(line))
