"""Encoders, touch sensors, RFID and victims; the samples are conformance vectors."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.readings import Reading, reading_from_message
from catoptra_protocol.usarsim.readings_encoders_and_tags import (
    EncoderReadings,
    RfidReading,
    TouchReadings,
    VictimPart,
    VictimReading,
)
from catoptra_protocol.usarsim.reports import line_from_report

NAMES = st.text("abcXYZ_09", min_size=1, max_size=9)
TICKS = st.lists(st.tuples(NAMES, st.integers(-(2**31), 2**31)), max_size=8).map(tuple)
TOUCHED = st.lists(st.tuples(NAMES, st.booleans()), max_size=8).map(tuple)
IDS = st.lists(st.integers(0, 2**31), max_size=8).map(tuple)
READINGS = (
    st.builds(EncoderReadings, TICKS)
    | st.builds(TouchReadings, TOUCHED)
    | st.builds(RfidReading, st.just(1.5), NAMES, IDS)
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(READINGS)
def test_reading_when_any_is_written_and_read_is_the_same(reading: Reading) -> None:
    line = line_from_report(reading).decode()
    assert reading_from_message(parse_message(line.rstrip())) == reading


def test_time_when_known_is_printed_by_udk_only() -> None:
    reading = EncoderReadings((("W1", 3),), time_s=2.0)
    assert b"Time" not in line_from_report(reading)
    assert line_from_report(reading, Dialect.UDK).startswith(b"SEN {Time 2.0000} {Type Encoder}")


def test_victims_without_a_name_are_read() -> None:
    line = "SEN {Time 5609.4467} {Type VictSensor} {Status NoVictims}"
    assert reading_from_message(parse_message(line)) == VictimReading(5609.4467, "", "NoVictims")


def test_victims_when_in_view_list_each_part_with_its_location() -> None:
    parts = (VictimPart("Head", (1.5, 0.0, -0.25)), VictimPart("Arm", (1.0, 0.5, 0.0)))
    reading = VictimReading(1.0, "V", "", parts)
    line = line_from_report(reading).decode().rstrip()
    assert line.endswith(
        "{PartName Head} {Location 1.50,0.00,-0.25} {PartName Arm} {Location 1.00,0.50,0.00}"
    )
    assert reading_from_message(parse_message(line)) == reading


BAD = [
    ("SEN {Type Encoder} {Name A}", "without {Tick}"),
    ("SEN {Type Encoder} {Name A Tick x}", "Tick x"),
    ("SEN {Time 1} {Type RFID} {Name R} {ID x}", "ID x"),
    ("SEN {Time 1} {Type RFID} {ID 1}", "without {Name}"),
    ("SEN {Type RFID} {Name R}", "without {Time}"),
    ("SEN {Type VictSensor} {Name V} {PartName Leg} {Location 1,2}", "Location 1,2"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_reading_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        reading_from_message(parse_message(line))
