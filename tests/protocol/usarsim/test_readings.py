"""Readings of sensors."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_SERVER_LINE_BYTES
from catoptra_protocol.usarsim.grammar import Dialect, LineReader, parse_message
from catoptra_protocol.usarsim.readings import (
    EncoderReadings,
    GpsReading,
    GroundTruthReading,
    InsReading,
    OdometryReading,
    RangeScanReading,
    Reading,
    RfidReading,
    SonarReadings,
    TouchReadings,
    VictimPart,
    VictimReading,
    reading_from_message,
)
from catoptra_protocol.usarsim.reports import line_from_report

SAMPLES = [
    (
        "SEN {Type Odometry} {Name Odometry} {Pose 0.0395,0.9854,2.5156}",
        OdometryReading("Odometry", 0.0395, 0.9854, 2.5156),
    ),
    (
        "SEN {Time 395.3833} {Type GroundTruth} {Name GroundTruth} {Location 4.50,1.90,1.85} "
        "{Orientation 0.00,6.28,6.28}",
        GroundTruthReading(395.3833, "GroundTruth", (4.5, 1.9, 1.85), (0.0, 6.28, 6.28)),
    ),
    (
        "SEN {Time 1.0000} {Type GroundTruth} {Name G} {Location -0.000001,0.250000,1.850000} "
        "{Orientation 0.000000,0.000000,3.141592}",
        GroundTruthReading(1.0, "G", (-0.000001, 0.25, 1.85), (0.0, 0.0, 3.141592), decimals=6),
    ),
]


@pytest.mark.parametrize(("line", "report"), SAMPLES)
def test_sen_when_written_and_read_equals_the_sample(line: str, report: Reading) -> None:
    assert line_from_report(report) == line.encode() + b"\r\n"
    assert reading_from_message(parse_message(line)) == report


UDK = [
    (
        "SEN {Time 2.5000} {Type Odometry} {Name Odometer} {Pose 1.0000,0.0000,0.0000}",
        OdometryReading("Odometer", 1.0, 0.0, 0.0, 2.5),
    ),
    (
        "SEN {Time 477.7582} {Type GroundTruth} {Name GndTruth} {Location -0.000,-0.000,0.017} "
        "{Orientation -0.000,0.000,0.000}",
        GroundTruthReading(477.7582, "GndTruth", (0, 0, 0.017), (0, 0, 0), decimals=3),
    ),
    ("SEN {Time 477.7743} {Type Camera} ", None),
]


@pytest.mark.parametrize(("line", "report"), UDK)
def test_sen_of_another_server_is_read_or_skipped(line: str, report: Reading | None) -> None:
    assert reading_from_message(parse_message(line)) == report


BAD = [
    ("SEN {Pose 1,2,3}", "without {Type}"),
    ("SEN {Type Odometry} {Name O}", "without {Pose}"),
    ("SEN {Type Odometry} {Pose 1,2,3}", "without {Name}"),
    ("SEN {Type Odometry} {Name O} {Pose 1,2}", "Pose 1,2"),
    ("SEN {Type Odometry} {Name O} {Pose 1,2,nan}", "Pose 1,2,nan|Pose nan"),
    ("SEN {Type GroundTruth} {Name G} {Location 1,2,3} {Orientation 0,0,0}", "without {Time}"),
    ("SEN {Time x} {Type GroundTruth} {Name G} {Location 1,2,3} {Orientation 0,0,0}", "Time x"),
    ("SEN {Time 1} {Type GroundTruth} {Name G} {Orientation 0,0,0}", "without {Location}"),
    ("SEN {Time 1} {Type GroundTruth} {Name G} {Location 1,2,3}", "without {Orientation}"),
    ("SEN {Type RangeScanner} {Name S}", "without {Time}"),
    ("SEN {Time 1} {Type RangeScanner} {Name S} {Resolution 1} {FOV 2}", "without {Range}"),
    ("SEN {Time 1} {Type RangeScanner} {Name S} {Resolution 1} {FOV 2} {Range 1,x}", "Range x"),
    ("SEN {Time 1} {Type Sonar} {Name F1}", "without {Range}"),
    ("SEN {Time 1} {Type Sonar} {Name F1 Range}", "without {Range}"),
    ("SEN {Time 1} {Type Sonar} {Name F1 Range far}", "Range far"),
    ("SEN {Type Sonar} {Name F1 Range 1}", "without {Time}"),
    ("SEN {Type GPS} {Name G} {Latitude 39,8.0,N} {Fix 1} {Satellites 3}", "without {Longitude}"),
    (
        "SEN {Type GPS} {Name G} {Latitude 39,8.0} {Longitude 1,2,E} {Fix 1} {Satellites 3}",
        "degrees,minutes,side",
    ),
    (
        "SEN {Type GPS} {Name G} {Latitude 39,8.0,X} {Longitude 1,2,E} {Fix 1} {Satellites 3}",
        "one of N, S",
    ),
    (
        "SEN {Type GPS} {Name G} {Latitude 999,8.0,N} {Longitude 1,2,E} {Fix 1} {Satellites 3}",
        "at most 180",
    ),
    (
        "SEN {Type GPS} {Name G} {Latitude a,8.0,N} {Longitude 1,2,E} {Fix 1} {Satellites 3}",
        "Latitude a",
    ),
    ("SEN {Type GPS} {Name G} {Fix 0}", "without {Satellites}"),
    ("SEN {Type Encoder} {Name A}", "without {Tick}"),
    ("SEN {Type Encoder} {Name A Tick x}", "Tick x"),
    ("SEN {Time 1} {Type RFID} {Name R} {ID x}", "ID x"),
    ("SEN {Time 1} {Type RFID} {ID 1}", "without {Name}"),
    ("SEN {Type RFID} {Name R}", "without {Time}"),
    ("SEN {Type VictSensor} {Name V} {PartName Leg} {Location 1,2}", "Location 1,2"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_sen_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        reading_from_message(parse_message(line))


ANGLES = [
    (0.0, "0.0000"),
    (-0.0, "0.0000"),
    (math.pi, "3.1415"),
    (-math.pi / 2, "4.7123"),
    (-1e-9, "6.2831"),
    (-1e-20, "0.0000"),  # its remainder rounds to 2 pi itself, which is not in the range
    (2.0 * math.pi, "0.0000"),
    (-20.0, "5.1327"),
]


@pytest.mark.parametrize(("angle_rad", "text"), ANGLES)
def test_ground_truth_when_written_has_angles_from_0_to_2_pi(angle_rad: float, text: str) -> None:
    reading = GroundTruthReading(1.0, "G", (0, 0, 0), (0, 0, angle_rad), decimals=4)
    assert line_from_report(reading).endswith(f",{text}}}\r\n".encode())


METRES = st.floats(-1e6, 1e6)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(METRES, METRES, METRES)
def test_odometry_when_written_and_read_loses_less_than_the_last_decimal(
    x_m: float, y_m: float, yaw_rad: float
) -> None:
    (line,) = LineReader().receive(line_from_report(OdometryReading("O", x_m, y_m, yaw_rad)))
    reading = reading_from_message(parse_message(line))
    assert isinstance(reading, OdometryReading)
    read = (reading.x_m, reading.y_m, reading.yaw_rad)
    assert read == pytest.approx((x_m, y_m, yaw_rad), rel=0, abs=1.0001e-4)  # 4 decimals


def test_ins_in_udk_is_rounded_and_in_ut2004_truncated() -> None:
    reading = InsReading("I", (0.2085, -0.0001, -0.338), (0.0, 0.0, -0.127))
    udk = line_from_report(reading, Dialect.UDK)
    assert b"{Location 0.21,-0.00,-0.34} {Orientation 0.00,0.00,-0.13}" in udk
    assert b"{Location 0.20,-0.00,-0.33}" in line_from_report(reading)


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


GPS_ANGLES = st.integers(-180 * 600_000, 180 * 600_000).map(lambda units: units / 600_000)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(GPS_ANGLES, GPS_ANGLES)
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
