"""Replies to work that raised an exception: every client that waits for a reply gets one."""

from __future__ import annotations

from typing import assert_never

from catoptra_protocol.usarsim.command_results import STATUS_FAILED
from catoptra_protocol.usarsim.commands import Init, Set
from catoptra_protocol.usarsim.reports import CommandResult
from catoptra_server.simulation.simulation_events import (
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
)

# The log has the traceback, which would tell a client nothing.
FAULT_REASON = "an internal fault ended this request: see the server's log"


def reply_fault(event: ClientWork, time_s: float) -> None:
    """Reply to work that raised, wherever its client waits for a reply."""
    match event:
        case CommandReceived(client, Init()):
            client.reject_init(FAULT_REASON)
        case CommandReceived(client, Set() as command):
            name = command.name or ""
            result = CommandResult(time_s, command.type, name, STATUS_FAILED)
            client.deliver([result])
        case CommandReceived():
            pass  # no other command has a reply
        case StepRequested():
            event.reply(StepResult(time_s, failure=FAULT_REASON))
        case ResetRequested(_, reply):
            reply()
        case AccuracyTargetChanged():
            event.reply(Fault(FAULT_REASON), event.camera)
        case LandmarksRequested() | PixelRequested() | StateRequested():
            event.reply(time_s, Fault(FAULT_REASON))
        case NotePublished() | SharedRobotDriven():
            event.reply(FAULT_REASON)
        case _:
            assert_never(event)
