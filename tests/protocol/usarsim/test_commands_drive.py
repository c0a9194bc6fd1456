"""DRIVE by joint, MULTIDRIVE and MISPKG; wheel speeds are in test_commands."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.limits import MAX_COMMAND_NUMBER, MAX_NAME_CHARS
from catoptra_protocol.usarsim.commands import command_from_message, line_from_command
from catoptra_protocol.usarsim.commands_drive import (
    ControlOrder,
    Drive,
    DriveJoints,
    JointCommand,
    LinkCommand,
    MisPkg,
    MultiDrive,
)
from catoptra_protocol.usarsim.grammar import parse_message

DriveCommand = DriveJoints | MultiDrive | MisPkg


def read(line: str) -> object:
    return command_from_message(parse_message(line))


WRITTEN: list[tuple[DriveCommand, str]] = [
    (DriveJoints((JointCommand("FRFlipper", 1.5),)), "DRIVE {Name FRFlipper} {Value 1.5}"),
    (
        DriveJoints((JointCommand("Arm", -0.5, ControlOrder.RELATIVE_ANGLE, 0.25),)),
        "DRIVE {Name Arm} {Steer 0.25} {Order 10} {Value -0.5}",
    ),
    (
        DriveJoints((JointCommand("A", 1.0), JointCommand("B", -2.0, ControlOrder.SPEED))),
        "DRIVE {Name A} {Value 1.0} {Name B} {Order 1} {Value -2.0}",
    ),
    (MultiDrive((("A", 1.0), ("B", -2.0))), "MULTIDRIVE {A 1.0} {B -2.0}"),
    (MultiDrive(()), "MULTIDRIVE"),
    (
        MisPkg("P", (LinkCommand(1, 0.5), LinkCommand(2, -1.0, ControlOrder.SPEED))),
        "MISPKG {Name P} {Link 1} {Value 0.5} {Link 2} {Value -1.0} {Order 1}",
    ),
    (MisPkg("P", gripper=1.0), "MISPKG {Name P} {Gripper 1.0}"),
    (MisPkg("P", sequence=3.0), "MISPKG {Name P} {Seq 3.0}"),
]


@pytest.mark.parametrize(("command", "line"), WRITTEN, ids=[line for _, line in WRITTEN])
def test_motion_when_written_and_read_is_the_same(command: DriveCommand, line: str) -> None:
    assert line_from_command(command) == line.encode() + b"\r\n"
    assert read(line) == command


def test_drive_with_a_side_is_of_the_wheels() -> None:
    assert read("DRIVE {Name R1} {Right 1}") == Drive(right=1.0)
    assert read("DRIVE {Light true}") == Drive(light=True)


def test_drive_of_a_single_joint_includes_blocks_before_its_name() -> None:
    assert read("DRIVE {Order 1} {Value 2} {Name A}") == DriveJoints((JointCommand("A", 2.0, 1),))


def test_drive_when_a_block_repeats_uses_the_first_of_each_joint() -> None:
    line = "DRIVE {Name A} {Value 1} {Value 9} {Name B} {Value 2}"
    assert read(line) == DriveJoints((JointCommand("A", 1.0), JointCommand("B", 2.0)))


def test_multi_drive_when_a_name_is_too_long_truncates_it() -> None:
    command = read("MULTIDRIVE {" + "n" * 999 + " 1}")
    assert command == MultiDrive((("n" * MAX_NAME_CHARS, 1.0),))


def test_mission_package_ignores_blocks_before_the_first_link() -> None:
    assert read("MISPKG {Value 3} {Name P} {Link 1}") == MisPkg("P", (LinkCommand(1),))


def test_multi_drive_when_a_joint_has_two_words_is_rejected() -> None:
    with pytest.raises(LocalProtocolError, match="cannot be sent"):
        line_from_command(MultiDrive((("front left", 1.0),)))


NAMES = st.text("abcXYZ_09", min_size=1, max_size=9)
NUMBERS = st.floats(-MAX_COMMAND_NUMBER, MAX_COMMAND_NUMBER)
LINKS = st.builds(LinkCommand, st.integers(-9, 99), st.none() | NUMBERS, st.integers(-3, 12))
JOINTS = st.builds(
    JointCommand, NAMES, st.none() | NUMBERS, st.integers(-3, 12), st.none() | NUMBERS
)
DRIVE_COMMANDS = (
    st.builds(DriveJoints, st.lists(JOINTS, min_size=1).map(tuple))
    | st.builds(MultiDrive, st.lists(st.tuples(NAMES, NUMBERS)).map(tuple))
    | st.builds(MisPkg, NAMES, st.lists(LINKS).map(tuple), st.none() | NUMBERS, st.none() | NUMBERS)
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(DRIVE_COMMANDS)
def test_motion_when_any_is_written_and_read_is_the_same(command: DriveCommand) -> None:
    assert read(line_from_command(command).decode("latin-1").rstrip()) == command


@pytest.mark.parametrize(
    "line",
    [
        "DRIVE {Left 1} {Right -1e10}",
        "DRIVE {Name J} {Value 1e10}",
        "DRIVE {Name J} {Value 1} {Order 1e300}",
        "DRIVE {Name J} {Steer 1e999}",
        "MULTIDRIVE {A 1} {B 1e10}",
        "MISPKG {Name P} {Link 1e300} {Value 1}",
        "MISPKG {Name P} {Link 1} {Value 1e300}",
        "MISPKG {Name P} {Gripper 1e300}",
        "MULTIDRIVE " + 257 * "{A 1}",
        "DRIVE " + 257 * "{Name J} {Value 1}",
        "MISPKG {Name P} " + 257 * "{Link 1} {Value 1}",
    ],
    ids=lambda line: line[:40],
)
def test_motion_command_when_beyond_a_limit_is_no_command(line: str) -> None:
    assert command_from_message(parse_message(line)) is None


@pytest.mark.parametrize(
    "block", ["{a}", "{a 1}", "{Name J}", "{Name J} {Value 1}", "{Link 1}", "{", "}", "{ab 12345}"]
)
@pytest.mark.parametrize("word", ["DRIVE", "MULTIDRIVE", "MISPKG", "INIT", "SET"])
def test_line_of_64_kb_when_parsed_costs_less_than_5_ms(word: str, block: str) -> None:
    line = word + " " + block * (65_000 // len(block))
    started_s = time.process_time()
    command_from_message(parse_message(line))
    # 1 to 3 ms on an idle core; the loop of all connections stands still for as long.
    assert time.process_time() - started_s < 0.025
