"""The table of states: complete, and as real clients and servers require."""

from __future__ import annotations

from typing import get_args

import pytest

from catoptra_protocol.usarsim.commands import COMMAND_PARSERS, Command, GetStartPoses, Init, Step
from catoptra_protocol.usarsim.control_states import TRANSITIONS, ControlState


def test_table_has_a_row_for_every_state() -> None:
    assert set(TRANSITIONS) == set(ControlState)


@pytest.mark.parametrize("command", get_args(Command))
def test_table_accepts_every_command_in_some_state(command: type[Command]) -> None:
    assert any(command in row for row in TRANSITIONS.values())
    assert command.WORD in COMMAND_PARSERS


def test_table_without_a_robot_accepts_commands_that_need_none() -> None:
    assert set(TRANSITIONS[ControlState.GREETED]) == {Init, GetStartPoses, Step}


def test_table_with_a_robot_accepts_all_except_a_second_init() -> None:
    assert set(TRANSITIONS[ControlState.SPAWNED]) == set(get_args(Command)) - {Init}
