"""SEN, against the samples of real servers."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim.grammar import Dialect, LineReader, parse_message
from catoptra_protocol.usarsim.readings import (
    GroundTruthReading,
    InsReading,
    OdometryReading,
    Reading,
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
