"""Forms of lines: captures of USARSim match, lines with one thing changed do not."""

from __future__ import annotations

import pytest

from conformance.control_forms import (
    CONFIGURATION_FORMS,
    PART_GEOMETRY_FORMS,
    READING_FORMS,
    ROBOT_GEOMETRY_FORM,
    matches_form,
)

SONARS = "SEN {Time 395.6055} {Type Sonar} {Name F1 Range 4.5604} {Name F2 Range 2.4576}"
TRUTH = (
    "SEN {Time 1.0000} {Type GroundTruth} {Name G} {Location -0.00,0.00,0.10} "
    "{Orientation 0.00,6.28,6.28}"
)
GEOMETRY = (
    "GEO {Type GroundVehicle} {Name P2AT} {Dimensions 0.5238,0.4968,0.2913} "
    "{COG 0.0000,0.0000,0.0000} {WheelRadius 0.1300} {WheelSeparation 0.4712} {WheelBase 0.2884}"
)
SCANNER = (
    "CONF {Type RangeScanner} {Name Scanner1} {MaxRange 20.0000} {MinRange 0.1000} "
    "{Resolution 0.0174} {Fov 3.1415} {Paning True} {Tilting False}"
)
UDK_GEOMETRY = (
    "GEO {Type RangeScanner} {Name lms200} {Location 0.21,-0.00,-0.20} "
    "{Orientation 0.00,-0.00,-0.00}{Mount P3AT}"
)
UT2004, UDK = READING_FORMS["ut2004"], READING_FORMS["udk"]


@pytest.mark.parametrize(
    ("text", "form", "dialect"),
    [
        (SONARS, UT2004["sonar"], "ut2004"),
        ("SEN {Time 477.7} {Type Sonar} {Name F1} {Range 4.0}", UDK["sonar"], "udk"),
        ("SEN {Type Odometry} {Name O} {Pose 0.0,0.9,2.5}", UT2004["odometry"], "ut2004"),
        ("SEN {Time 1.0} {Type Odometry} {Name O} {Pose 0.0,0.9,2.5}", UDK["odometry"], "udk"),
        (f"{TRUTH} {{Further 1}}", UT2004["groundtruth"], "ut2004"),
        (GEOMETRY, ROBOT_GEOMETRY_FORM, "ut2004"),
        (SCANNER, CONFIGURATION_FORMS["ut2004"]["rangescanner"], "ut2004"),
        (UDK_GEOMETRY, PART_GEOMETRY_FORMS["udk"], "udk"),
    ],
)
def test_line_when_captured_matches_its_form(text: str, form: str, dialect: str) -> None:
    assert matches_form(text, form, dialect)


@pytest.mark.parametrize(
    ("text", "form"),
    [
        (SONARS.replace("{Time 395.6055} ", ""), UT2004["sonar"]),
        (SONARS.replace("} {Name F2", "}{Name F2"), UT2004["sonar"]),
        (SONARS.replace("4.5604", "4.56e0"), UT2004["sonar"]),
        (TRUTH.replace("0.10}", "0.10,1.00}"), UT2004["groundtruth"]),
        (TRUTH.replace("{Name G} ", ""), UT2004["groundtruth"]),
        (GEOMETRY.replace("{WheelRadius 0.1300} ", ""), ROBOT_GEOMETRY_FORM),
        (SCANNER.replace("Paning", "Panning"), CONFIGURATION_FORMS["ut2004"]["rangescanner"]),
        (UDK_GEOMETRY, PART_GEOMETRY_FORMS["ut2004"]),
    ],
)
def test_line_when_one_thing_is_wrong_does_not_match(text: str, form: str) -> None:
    assert not matches_form(text, form, "ut2004")
