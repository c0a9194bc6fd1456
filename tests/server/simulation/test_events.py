"""Each kind of work that raised has one reply, where its client waits for one."""

from __future__ import annotations

from typing import get_args

import pytest

from catoptra_protocol.usarsim.commands import Drive, Init, Note, SetCommand
from catoptra_protocol.usarsim.reports import CommandResult
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.simulation.events import (
    FAULT_REASON,
    AccuracyTargetChanged,
    ClientWork,
    CommandReceived,
    Fault,
    LandmarksRequested,
    NotePublished,
    PixelRequested,
    ResetRequested,
    SharedRobotDriven,
    StateRequested,
    StepRequested,
    StepResult,
    reply_fault,
)
from helpers.robots import FakeClient

CLIENT = FakeClient()
REPLIES = list[object]()


def store(*reply: object) -> None:
    REPLIES.append(reply)


WORK: tuple[tuple[ClientWork, list[object]], ...] = (
    (StepRequested(CLIENT, 1.0, store), [(StepResult(0.5, failure=FAULT_REASON),)]),
    (ResetRequested(CLIENT, store), [()]),
    (LandmarksRequested(CLIENT, CameraChannel("R", ""), store), [(0.5, Fault(FAULT_REASON))]),
    (AccuracyTargetChanged(CLIENT, "Omni", 1.0, None, store), [(Fault(FAULT_REASON), "Omni")]),
    (
        PixelRequested(CLIENT, CameraChannel("R", ""), (0.5, 0.5), store),
        [(0.5, Fault(FAULT_REASON))],
    ),
    (StateRequested(CLIENT, "R", None, None, store), [(0.5, Fault(FAULT_REASON))]),
    (NotePublished(CLIENT, Note("ekf", "{}"), store), [(FAULT_REASON,)]),
    (SharedRobotDriven(CLIENT, "R", Drive(1.0, 1.0), store), [(FAULT_REASON,)]),
    (CommandReceived(CLIENT, Drive(1.0, 1.0)), []),
)


@pytest.mark.parametrize(("work", "replies"), WORK, ids=lambda work: type(work).__name__)
def test_work_with_a_reply_has_it(work: ClientWork, replies: list[object]) -> None:
    REPLIES.clear()
    reply_fault(work, 0.5)
    assert replies == REPLIES
    assert CLIENT.reports == []


def test_work_when_listed_is_all_there_is() -> None:
    assert {type(work) for work, _ in WORK} == set(get_args(ClientWork))


def test_commands_with_a_reply_on_the_control_port_have_it() -> None:
    client = FakeClient()
    reply_fault(CommandReceived(client, Init("OmniP2AT")), 0.5)
    reply_fault(CommandReceived(client, SetCommand("Odometry", "O", "RESET")), 0.5)
    assert client.rejections == [FAULT_REASON]
    assert client.reports == [CommandResult(0.5, "Odometry", "O", "Failed")]
