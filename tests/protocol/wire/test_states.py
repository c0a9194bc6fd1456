"""The table of states: complete, and as real clients and servers want it."""

from __future__ import annotations

from typing import get_args

import pytest

from catoptra_protocol.wire.commands import COMMANDS, Command, GetStartPoses, Init, Step
from catoptra_protocol.wire.states import SERVED, ControlState


def test_table_when_read_has_a_row_for_every_state() -> None:
    assert set(SERVED) == set(ControlState)


@pytest.mark.parametrize("command", get_args(Command))
def test_table_when_read_serves_every_command_in_some_state(command: type[Command]) -> None:
    assert any(command in row for row in SERVED.values())
    assert command.WORD in COMMANDS


def test_table_when_there_is_no_robot_serves_what_needs_none() -> None:
    assert set(SERVED[ControlState.GREETED]) == {Init, GetStartPoses, Step}


def test_table_when_there_is_a_robot_serves_all_but_a_second_init() -> None:
    assert set(SERVED[ControlState.SPAWNED]) == set(get_args(Command)) - {Init}
