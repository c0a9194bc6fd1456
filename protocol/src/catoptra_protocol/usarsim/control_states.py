"""The states of a control connection, and the table of commands accepted in each.

ACCEPTED --send Greeting--> GREETED --receive Init--> SPAWNED --reject_init--> GREETED

To add a command: its entry in every state that accepts the command; without an entry the command is
dropped silently.
"""

from __future__ import annotations

from enum import Enum, auto

from catoptra_protocol.usarsim.commands import (
    Command,
    Drive,
    DriveJoints,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    MisPkg,
    MultiDrive,
    Set,
    SetViewports,
    Step,
    Trace,
)


class ControlState(Enum):
    """State of a connection, from the side of the server."""

    ACCEPTED = auto()
    """Connected; the server sends first."""
    GREETED = auto()
    """Without a robot."""
    SPAWNED = auto()
    """An INIT was handed to the simulation: the connection has its robot, or will be rejected."""


# Commands accepted in a state, and the next state. All others are dropped silently: a command that
# needs a robot, or a second INIT (undefined in the reference).
TRANSITIONS: dict[ControlState, dict[type[Command], ControlState]] = {
    ControlState.ACCEPTED: {},
    ControlState.GREETED: {
        Init: ControlState.SPAWNED,
        # Start poses serve to choose the pose of INIT; a step belongs to the clock, not to a robot.
        GetStartPoses: ControlState.GREETED,
        Step: ControlState.GREETED,
    },
    ControlState.SPAWNED: {
        Drive: ControlState.SPAWNED,
        DriveJoints: ControlState.SPAWNED,
        MultiDrive: ControlState.SPAWNED,
        MisPkg: ControlState.SPAWNED,
        Set: ControlState.SPAWNED,
        SetViewports: ControlState.SPAWNED,
        Trace: ControlState.SPAWNED,
        GetConf: ControlState.SPAWNED,
        GetGeo: ControlState.SPAWNED,
        GetStartPoses: ControlState.SPAWNED,
        Step: ControlState.SPAWNED,
    },
}
