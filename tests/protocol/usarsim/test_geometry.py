"""GEO, against the samples of real servers."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim.configurations import (
    Geometry,
    GeometryItem,
    VehicleGeometry,
    geometry_from_message,
)
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.reports import line_from_report

F2 = GeometryItem("F2", (0.185, -0.115, 0.0), (0.0, 0.0, -0.8727))
F3 = GeometryItem("F3", (0.22, -0.08, 0.0), (0.0, 0.0, -0.5236))
CAMERA = GeometryItem("Camera", (0.082, 0.0002, 0.0613), (0.0, 0.0, 0.0), "CameraTilt")
P2AT = VehicleGeometry("P2AT", (0.5238, 0.4968, 0.2913), (0.0, 0.0, 0.0), 0.13, 0.4712, 0.2884)

SAMPLES = [
    (
        "GEO {Type GroundVehicle} {Name P2AT} {Dimensions 0.5238,0.4968,0.2913} "
        "{COG 0.0000,0.0000,0.0000} {WheelRadius 0.1300} {WheelSeparation 0.4712} "
        "{WheelBase 0.2884}",
        P2AT,
    ),
    (
        "GEO {Type Sonar} {Name F2 Location 0.1850,-0.1150,0.0000 Orientation "
        "0.0000,0.0000,-0.8727 Mount HARD} {Name F3 Location 0.2200,-0.0800,0.0000 Orientation "
        "0.0000,0.0000,-0.5236 Mount HARD}",
        Geometry("Sonar", (F2, F3)),
    ),
    (
        "GEO {Type Camera} {Name Camera Location 0.0820,0.0002,0.0613 Orientation "
        "0.0000,0.0000,0.0000 Mount CameraTilt}",
        Geometry("Camera", (CAMERA,)),
    ),
    ("GEO {Type RFID}", Geometry("RFID")),
    ("GEO {Type Sonar} {Name F9}", Geometry("Sonar", name="F9")),
    ("GEO {Type Sonar} {Name not a sonar}", Geometry("Sonar", name="not a sonar")),
]


@pytest.mark.parametrize(("line", "report"), SAMPLES)
def test_geo_when_written_and_read_equals_the_sample(
    line: str, report: Geometry | VehicleGeometry
) -> None:
    assert line_from_report(report) == line.encode() + b"\r\n"
    assert geometry_from_message(parse_message(line)) == report


def test_geo_of_udk_in_separate_blocks_is_read() -> None:
    line = (
        "GEO {Type RangeScanner} {Name lms200} {Location 0.21,-0.00,-0.20} "
        "{Orientation 0.00,-0.00,-0.00}{Mount P3AT}"
    )
    item = GeometryItem("lms200", (0.21, 0.0, -0.2), (0.0, 0.0, 0.0), "P3AT")
    assert geometry_from_message(parse_message(line)) == Geometry("RangeScanner", (item,))


BAD = [
    ("GEO {Name A}", "without {Type}"),
    ("GEO {Type Sonar} {Name F Location 1,2,3 Mount HARD}", "without {Orientation}"),
    ("GEO {Type Sonar} {Name F Location 1,2 Orientation 0,0,0 Mount HARD}", "Location 1,2"),
    ("GEO {Type Sonar} {Name F Location 1,2,3 Orientation 0,0,0 Mount}", "without {Mount}"),
    ("GEO {Type Sonar} {Location 1,2,3} {Orientation 0,0,0} {Mount M}", "without {Name}"),
    ("GEO {Type GroundVehicle} {Name P} {Dimensions 1,2,3}", "without {COG}"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_geo_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        geometry_from_message(parse_message(line))


@pytest.mark.parametrize(("name", "mount"), [("two words", "HARD"), ("F", ""), ("", "HARD")])
def test_item_when_name_or_mount_is_not_one_word_is_rejected(name: str, mount: str) -> None:
    item = GeometryItem(name, (0, 0, 0), (0, 0, 0), mount)
    with pytest.raises(LocalProtocolError, match="one word"):
        line_from_report(Geometry("Sonar", (item,)))


@pytest.mark.parametrize("name", ["\t", "\xa0", "Location"])
def test_geo_with_an_odd_name_is_an_empty_reply(name: str) -> None:
    line = f"GEO {{Type Sonar}} {{Name {name}}}"
    assert geometry_from_message(parse_message(line)) == Geometry("Sonar", name=name)


def test_mount_in_udk_is_the_model_of_the_robot() -> None:
    on_link = GeometryItem("C", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "CameraTilt")
    for item in (F2, on_link):
        line = line_from_report(Geometry("X", (item,), model="P2AT"), Dialect.UDK).decode()
        assert line.endswith("}{Mount P2AT}\r\n")
        assert "P2AT" not in line_from_report(Geometry("X", (item,), model="P2AT")).decode()
