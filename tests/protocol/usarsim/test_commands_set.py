"""SET of sensors, cameras and viewports, and TRACE."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.usarsim.commands import (
    Set,
    SetViewports,
    Trace,
    command_from_message,
    line_from_command,
)
from catoptra_protocol.usarsim.grammar import parse_message

SetCommand = Set | SetViewports | Trace


def read(line: str) -> object:
    return command_from_message(parse_message(line))


WRITTEN: list[tuple[SetCommand, str]] = [
    (Set("Odometry", "Odometry", "RESET"), "SET {Type Odometry} {Name Odometry} {Opcode RESET}"),
    (Set("Camera", "Camera", fov_rad=0.7853), "SET {Type Camera} {Name Camera} {FOV 0.7853}"),
    (
        Set("INS", "INS", "POSE", "1,2,3,0,0,1.57"),
        "SET {Type INS} {Name INS} {Opcode POSE} {Params 1,2,3,0,0,1.57}",
    ),
    (
        SetViewports("SingleView", ("Camera", "Disable", None, None)),
        "SET {Type Viewports} {Config SingleView} {Viewport1 Camera} {Viewport2 Disable}",
    ),
    (Trace(True, 0.5, "Red"), "TRACE {On true} {Interval 0.5} {Color Red}"),
    (Trace(), "TRACE {On false}"),
]


@pytest.mark.parametrize(("command", "line"), WRITTEN, ids=[line for _, line in WRITTEN])
def test_setting_when_written_and_read_is_the_same(command: SetCommand, line: str) -> None:
    assert line_from_command(command) == line.encode() + b"\r\n"
    assert read(line) == command


PARAMETERS = [
    ("1.0,2.0,0.5,0,0,1.57", (1.0, 2.0, 0.5, 0.0, 0.0, 1.57)),
    ("1 2", (1.0, 2.0)),
    ("fast", (0.0,)),
    (None, ()),
]


@pytest.mark.parametrize(("params", "numbers"), PARAMETERS)
def test_parameters_as_numbers_are_separated_like_vectors(
    params: str | None, numbers: tuple[float, ...]
) -> None:
    assert Set("INS", params=params).numeric_params == numbers


FIELDS_OF_VIEW = [
    (Set("Camera", fov_rad=0.5), 0.5),
    (Set("Camera", opcode="zoom", params="0.25"), 0.25),
    (Set("Camera", opcode="FOV", params="0"), 0.0),
    (Set("Camera", opcode="FOV"), 0.0),
    (Set("Camera", opcode="RESET"), None),
    (Set("Camera"), None),
]


@pytest.mark.parametrize(("command", "fov_rad"), FIELDS_OF_VIEW, ids=str)
def test_field_of_view_in_either_form_is_parsed(command: Set, fov_rad: float | None) -> None:
    assert command.parse_fov_rad() == fov_rad


WORDS = st.none() | st.text("abcXYZ_,.09", min_size=1, max_size=9)
NUMBERS = st.none() | st.floats(allow_nan=False, allow_infinity=False)
SET_COMMANDS = (
    st.builds(Set, st.sampled_from(["INS", "Camera", "K"]), WORDS, WORDS, WORDS, NUMBERS)
    | st.builds(SetViewports, WORDS, st.tuples(WORDS, WORDS, WORDS, WORDS))
    | st.builds(Trace, st.booleans(), NUMBERS, WORDS)
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(SET_COMMANDS)
def test_setting_when_any_is_written_and_read_is_the_same(command: SetCommand) -> None:
    assert read(line_from_command(command).decode("latin-1").rstrip()) == command
