"""Commands of real clients, and those of ours."""

from __future__ import annotations

import math
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_COMMAND_NUMBER, MAX_NAME_CHARS
from catoptra_protocol.usarsim.commands import (
    COMMAND_PARSERS,
    Command,
    Drive,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    Step,
    command_from_message,
    line_from_command,
)
from catoptra_protocol.usarsim.grammar import LineReader, parse_message

DETERMINISTIC = settings(derandomize=True, max_examples=200, deadline=None)

FINITE = st.floats(allow_nan=False, allow_infinity=False)
SET_POINTS = st.floats(-MAX_COMMAND_NUMBER, MAX_COMMAND_NUMBER)
VECTORS = st.tuples(FINITE, FINITE, FINITE)
NAMES = st.text(st.characters(codec="ascii", categories=["L", "N"]), min_size=1, max_size=9)
OPTIONAL_NAMES = st.none() | NAMES
OPTIONAL_BOOLEANS = st.none() | st.booleans()

ANY_COMMAND = st.one_of(
    st.builds(Init, NAMES, OPTIONAL_NAMES, st.none() | VECTORS, VECTORS, OPTIONAL_NAMES),
    st.builds(
        Drive,
        st.none() | SET_POINTS,
        st.none() | SET_POINTS,
        st.booleans(),
        OPTIONAL_BOOLEANS,
        OPTIONAL_BOOLEANS,
    ),
    st.builds(GetConf, NAMES, OPTIONAL_NAMES),
    st.builds(GetGeo, NAMES, OPTIONAL_NAMES),
    st.just(GetStartPoses()),
    st.builds(Step, FINITE),
)

READ = [
    (
        "INIT {ClassName USARBot.P2AT} {Name R1} {Location 4.5,1.9,1.8} {Rotation 0,0,1.57}",
        Init("USARBot.P2AT", "R1", (4.5, 1.9, 1.8), (0.0, 0.0, 1.57)),
    ),
    # Player and maldo; makokal and MATLAB; GameBots' separate arguments.
    ("INIT {ClassName A} {Location 1.5 1.0 0.2}", Init("A", location_m=(1.5, 1.0, 0.2))),
    ("INIT {ClassName A} {Location .4, .4, 1.8}", Init("A", location_m=(0.4, 0.4, 1.8))),
    ("INIT {ClassName A}{X 1}{Y 2}{Z 3}", Init("A", location_m=(1.0, 2.0, 3.0))),
    ("INIT {ClassName A}{Y 2}", Init("A", location_m=(0.0, 2.0, 0.0))),
    # The NIST client's spelling, a start pose, and a rotation of pi as usarros sends it.
    ("init {Classname A} {Start Robot2}", Init("A", start="Robot2")),
    (
        "Init {ClassName A} {Location 0,0,0} {Rotation 3.1415926,0,0}",
        Init("A", None, (0.0, 0.0, 0.0), (3.1415926, 0.0, 0.0)),
    ),
    ("INIT", Init("")),
    ("INIT {ClassName } {Name }", Init("")),
    ("DRIVE {Left 1.0} {Right -2.5}", Drive(1.0, -2.5)),
    ("Drive {Left 1.357231} {Right 1.719692}", Drive(1.357231, 1.719692)),
    ("DRIVE {Left 1.0}", Drive(left=1.0)),
    ("DRIVE {Right 1.0}", Drive(right=1.0)),
    ("DRIVE {Left 50} {Right 50} {Normalized true}", Drive(50.0, 50.0, normalized=True)),
    ("DRIVE {Left 50} {Right 50} {Normalized FALSE}", Drive(50.0, 50.0)),
    ("DRIVE {Light true} {Flip 1}", Drive(light=True, flip=True)),
    ("DRIVE {Light False} {Flip 0}", Drive(light=False, flip=False)),
    ("DRIVE {Left fast} {Right nan}", Drive(0.0, 0.0)),
    ("DRIVE", Drive()),
    ("GETCONF {Type Robot} {Name R1}", GetConf("Robot", "R1")),
    ("getconf {Type Camera}", GetConf("Camera")),
    ("GETCONF", GetConf("")),
    ("GETGEO {Type Sonar}", GetGeo("Sonar")),
    ("GetGeo {Name F1} {Type Sonar}", GetGeo("Sonar", "F1")),
    ("getstartposes", GetStartPoses()),
    ("GETSTARTPOSES {Any thing}", GetStartPoses()),
    ("STEP {Time 0.2}", Step(0.2)),
    ("STEP", Step(0.0)),
    ("STEP {Time soon}", Step(0.0)),
    # To be ignored: unknown words, blank text, a word glued to the next message.
    ("PING", None),
    ("   ", None),
    ("{Left 1.0}", None),
    ("XDRIVE {Left 1.0}", None),
]


@pytest.mark.parametrize(("line", "command"), READ, ids=[line for line, _ in READ])
def test_command_from_message_of_known_clients_is_parsed(
    line: str, command: Command | None
) -> None:
    assert command_from_message(parse_message(line)) == command


WRITTEN = [
    (
        Init("USARBot.P2AT", "R1", (4.5, 1.9, 1.8), (0.0, 0.0, 1.57)),
        b"INIT {ClassName USARBot.P2AT} {Name R1} {Location 4.5,1.9,1.8} {Rotation 0.0,0.0,1.57}",
    ),
    (Init("A", start="Robot2"), b"INIT {ClassName A} {Start Robot2}"),
    (Drive(1.0, -2.5), b"DRIVE {Left 1.0} {Right -2.5}"),
    (Drive(1e-7, None), b"DRIVE {Left 0.0000001}"),
    (
        Drive(50.0, 50.0, True, light=True, flip=False),
        b"DRIVE {Left 50.0} {Right 50.0} {Normalized true} {Light true} {Flip false}",
    ),
    (GetConf("Robot"), b"GETCONF {Type Robot}"),
    (GetGeo("Sonar", "F1"), b"GETGEO {Type Sonar} {Name F1}"),
    (GetStartPoses(), b"GETSTARTPOSES"),
    (Step(0.2), b"STEP {Time 0.2}"),
]


@pytest.mark.parametrize(("command", "line"), WRITTEN, ids=[str(line) for _, line in WRITTEN])
def test_line_from_command_has_the_form_that_servers_read(command: Command, line: bytes) -> None:
    assert line_from_command(command) == line + b"\r\n"


@DETERMINISTIC
@given(ANY_COMMAND)
def test_line_from_command_when_parsed_again_is_the_same_command(command: Command) -> None:
    (line,) = LineReader().receive(line_from_command(command))
    assert command_from_message(parse_message(line)) == command


@pytest.mark.parametrize("command", [Step(math.nan), Drive(left=math.inf), Init("A}\r\nB")])
def test_line_from_command_when_invalid_raises(command: Command) -> None:
    with pytest.raises(LocalProtocolError, match="cannot be sent"):
        line_from_command(command)


def test_names_when_longer_than_a_reply_can_hold_are_truncated() -> None:
    command = command_from_message(parse_message("GETCONF {Type " + "x" * 5000 + "}"))
    assert command == GetConf("x" * MAX_NAME_CHARS)


@DETERMINISTIC
@given(st.sampled_from(sorted(COMMAND_PARSERS)), st.text())
def test_command_from_message_of_any_text_never_raises(word: str, text: str) -> None:
    command = command_from_message(parse_message(f"{word} {{{text}"))
    # A NOTE without valid data is none.
    assert isinstance(command, get_args(Command)) or (word == "NOTE" and command is None)
