"""The states of a control connection, in tables: what is served, what is dropped, what follows.

ACCEPTED --send Greeting--> GREETED --receive Init--> SPAWNED --refuse_init--> GREETED
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
    """Where a connection stands, seen from the server."""

    ACCEPTED = auto()  # the server speaks first
    GREETED = auto()  # no robot yet
    SPAWNED = auto()  # an Init was handed to the server; the connection has its robot


# The commands served in a state, and the state that follows. What is missing here is dropped in
# silence: a command that needs a robot, or a second INIT (undefined in the reference).
TRANSITIONS: dict[ControlState, dict[type[Command], ControlState]] = {
    ControlState.ACCEPTED: {},
    ControlState.GREETED: {
        Init: ControlState.SPAWNED,
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
