"""NFO, against the samples of real servers."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.greeting import (
    Greeting,
    StartPose,
    StartPoses,
    greeting_from_message,
)
from catoptra_protocol.usarsim.reports import line_from_report

ROBOT_2 = StartPose("Robot2", (16.9923, 2.46, 1.472), (0.0, 0.0, -4.7124))
ROBOT_1 = StartPose("Robot1", (-1.0, 0.0, 0.25), (0.0, 0.0, 0.0))

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
]


@pytest.mark.parametrize(("line", "report"), SAMPLES)
def test_nfo_when_written_and_read_equals_the_sample(
    line: str, report: Greeting | StartPoses
) -> None:
    assert line_from_report(report) == line.encode() + b"\r\n"
    assert greeting_from_message(parse_message(line)) == report


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
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_nfo_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        greeting_from_message(parse_message(line))


@pytest.mark.parametrize("name", ["", "two words"])
def test_start_pose_when_its_name_is_not_one_word_is_rejected(name: str) -> None:
    with pytest.raises(LocalProtocolError, match="one word"):
        line_from_report(StartPoses((StartPose(name, (0, 0, 0), (0, 0, 0)),)))
