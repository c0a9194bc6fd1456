"""Greeting, status, configurations and results as reports; the table of all."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_NAME_CHARS, MAX_SERVER_LINE_BYTES
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.reports import (
    CommandResult,
    Configuration,
    Geometry,
    Greeting,
    Report,
    StartPose,
    StartPoses,
    VehicleStatus,
    Viewport,
    ViewportsResult,
    line_from_report,
    report_from_message,
)

ROBOT_2 = StartPose("Robot2", (16.9923, 2.46, 1.472), (0.0, 0.0, -4.7124))
ROBOT_1 = StartPose("Robot1", (-1.0, 0.0, 0.25), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("name", ["", "two words"])
def test_start_pose_when_its_name_is_not_one_word_is_rejected(name: str) -> None:
    with pytest.raises(LocalProtocolError, match="one word"):
        line_from_report(StartPoses((StartPose(name, (0, 0, 0), (0, 0, 0)),)))


SAMPLES = [
    (
        "NFO {Gametype BotDeathMatch} {Level DM-USAR_yellow_250} {TimeLimit 0}",
        Greeting("BotDeathMatch", "DM-USAR_yellow_250"),
    ),
    (
        "NFO {Gametype BotDeathMatch} {Level EmptyRoom} {TimeLimit 20}",
        Greeting("BotDeathMatch", "EmptyRoom", 20),
    ),
    (
        "NFO {StartPoses 2} {Robot2 16.9923,2.4600,1.4720 0.0000,0.0000,-4.7124 "
        "Robot1 -1.0000,0.0000,0.2500 0.0000,0.0000,0.0000}",
        StartPoses((ROBOT_2, ROBOT_1)),
    ),
    (
        "NFO {StartPoses 1} {Robot2 16.9923,2.4600,1.4720 0.0000,0.0000,-4.7124}",
        StartPoses((ROBOT_2,)),
    ),
    ("NFO {StartPoses 0}", StartPoses(())),
    (
        "STA {Type GroundVehicle} {Time 395.38} {FrontSteer 0.0000} {RearSteer 0.0000} "
        "{LightToggle False} {LightIntensity 0} {Battery 1200} {View -1}",
        VehicleStatus(395.38, 1200),
    ),
    (
        "STA {Type GroundVehicle} {Time 0.00} {FrontSteer 0.0000} {RearSteer 0.0000} "
        "{LightToggle True} {LightIntensity 100} {Battery 0} {View 2}",
        VehicleStatus(0.0, 0, light=True, view=2),
    ),
    (
        "CONF {Type GroundVehicle} {Name P2AT} {SteeringType SkidSteered} {Mass 14.0000} "
        "{MaxSpeed 5.3850} {MaxTorque 60.0000} {MaxFrontSteer 0.0000} {MaxRearSteer 0.0000}",
        Configuration(
            "GroundVehicle",
            (
                ("Name", "P2AT"),
                ("SteeringType", "SkidSteered"),
                ("Mass", "14.0000"),
                ("MaxSpeed", "5.3850"),
                ("MaxTorque", "60.0000"),
                ("MaxFrontSteer", "0.0000"),
                ("MaxRearSteer", "0.0000"),
            ),
        ),
    ),
    ("CONF {Type RFID}", Configuration("RFID")),
    ("CONF {Type Sonar} {Name F9}", Configuration("Sonar", (("Name", "F9"),))),
    ("RES {Time 1.2000} {Type Step} {Name Clock} {Status OK}", CommandResult(1.2, "Step", "Clock")),
    (
        "RES {Time 0.0000} {Type Step} {Name Clock} {Status Failed}",
        CommandResult(0.0, "Step", "Clock", "Failed"),
    ),
]


@pytest.mark.parametrize(("line", "report"), SAMPLES)
def test_report_when_written_and_read_equals_the_sample(line: str, report: Report) -> None:
    assert line_from_report(report) == line.encode() + b"\r\n"
    assert report_from_message(parse_message(line)) == report


UDK = [
    (
        "STA {Time 477.7582} {Battery 99999} {Type GroundVehicle} {LightToggle False} "
        "{LightIntensity 100} {FrontSteer 0} {RearSteer 0}",
        VehicleStatus(477.7582, 99999),
    ),
    (
        "CONF {Name P3AT} {Type GroundVehicle} {SteeringType SkidSteered}",
        Configuration("GroundVehicle", (("Name", "P3AT"), ("SteeringType", "SkidSteered"))),
    ),
    (
        "CONF {Type Camera} {Name Camera}{TextureOffsetX 320}{CameraDefFov 80.0000}",
        Configuration(
            "Camera", (("Name", "Camera"), ("TextureOffsetX", "320"), ("CameraDefFov", "80.0000"))
        ),
    ),
    (
        "RES {Time 1.0} {Type Viewports} {Config SingleView} {Status OK} {Viewport1 Camera}",
        ViewportsResult(1.0, "SingleView", (Viewport("Camera"),)),
    ),
    ("DIE {Killer A}", None),
    ("FO {Gametype BotDeathMatch}", None),
    ("", None),
]


@pytest.mark.parametrize(("line", "report"), UDK)
def test_report_of_another_server_is_read_or_skipped(line: str, report: Report | None) -> None:
    assert report_from_message(parse_message(line)) == report


BAD = [
    ("NFO {Level A}", "without {Gametype}"),
    ("NFO {Gametype A}", "without {Level}"),
    ("NFO {Gametype A} {Level B} {TimeLimit soon}", "TimeLimit soon"),
    ("NFO {StartPoses 1}", "three words"),
    ("NFO {StartPoses 1} {A 1,2,3}", "three words"),
    ("NFO {StartPoses 2} {A 1,2,3 0,0,0}", "three words"),
    ("NFO {StartPoses many}", "StartPoses many"),
    ("NFO {StartPoses 1} {A 1,2 0,0,0}", "Location 1,2"),
    ("NFO {StartPoses 1} {A 1,2,3 0,0,x}", "Orientation 0,0,x"),
    ("STA {Time 1} {Type A}", "without {Battery}"),
    ("STA {Battery 1} {Type A}", "without {Time}"),
    ("STA {Time 1} {Battery full} {Type A}", "Battery full"),
    ("STA {Time 1} {Battery 1} {Type A} {View x}", "View x"),
    ("CONF {Name A}", "without {Type}"),
    ("RES {Time 1} {Type Step} {Name Clock}", "without {Status}"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_report_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        report_from_message(parse_message(line))


def test_configuration_lookup_ignores_case() -> None:
    configuration = Configuration("Camera", (("Name", "Omni"), ("name", "Other")))
    assert configuration.get("NAME") == "Omni"
    assert configuration.get("Width") is None


def test_line_when_longer_than_clients_read_is_rejected() -> None:
    with pytest.raises(LocalProtocolError, match=str(MAX_SERVER_LINE_BYTES)):
        line_from_report(Configuration("Sonar", (("Name", "x" * MAX_SERVER_LINE_BYTES),)))


def test_line_with_the_longest_names_is_valid() -> None:
    longest = "x" * MAX_NAME_CHARS
    assert line_from_report(Geometry(longest, name=longest)).count(b"x") == 2 * MAX_NAME_CHARS


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.sampled_from(["NFO", "STA", "SEN", "CONF", "GEO", "RES"]), st.text())
def test_report_from_message_of_any_text_raises_only_protocol_errors(word: str, text: str) -> None:
    report = None
    with contextlib.suppress(RemoteProtocolError):
        report = report_from_message(parse_message(f"{word} {text}"))
    assert report is None or report.WORD == word


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
