"""The commands of a control client: one frozen dataclass each, and their table COMMAND_PARSERS.

This module holds spawning, queries and STEP; `commands_drive` the motion commands, `commands_set`
the settings, `commands_publish` notes and sharing. A missing or malformed field becomes None, 0 or
an empty text, never an error; only a motion command beyond the limits of `commands_drive` and a
malformed note are no command.

To add a command: its class beside similar ones (WORD, fields, `from_message`, `to_pairs`), its
entries in the `Command` union and in COMMAND_PARSERS, a vector in tests/conformance/data/commands,
its row in SPEC.md; then its case in the simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import lenient_fields
from catoptra_protocol.usarsim.commands_drive import (
    ControlOrder,
    Drive,
    DriveJoints,
    JointCommand,
    LinkCommand,
    MisPkg,
    MultiDrive,
    drive_from_message,
)
from catoptra_protocol.usarsim.commands_publish import Note, ShareControl
from catoptra_protocol.usarsim.commands_set import Set, SetViewports, Trace, set_from_message
from catoptra_protocol.usarsim.grammar import Message, Pairs, format_line
from catoptra_protocol.usarsim.value_format import format_exact
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class Init:
    """Spawn a robot of a class at a location or at a start pose; the location takes precedence."""

    WORD: ClassVar[str] = "INIT"

    class_name: str
    """Class of the robot; package optional, any case."""
    name: str | None = None
    """Requested name; None lets the server choose."""
    location_m: Vector3 | None = None
    """Position in the world frame."""
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw in the world frame."""
    start: str | None = None
    """Name of a start pose."""

    @classmethod
    def from_message(cls, message: Message) -> Init:
        """Parse the message of a line."""
        return cls(
            # An INIT without a class goes on to the simulation, which logs the reason of each
            # rejection.
            class_name=lenient_fields.read_name(message, "ClassName") or "",
            name=lenient_fields.read_name(message, "Name"),
            location_m=_read_location(message),
            rotation_rad=lenient_fields.read_vector(message, "Rotation") or (0.0, 0.0, 0.0),
            start=lenient_fields.read_name(message, "Start"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(
            ("ClassName", self.class_name),
            ("Name", self.name),
            ("Location", self.location_m),
            # 0,0,0 is the default of every server (SPEC.md 4.3) and needs no block.
            ("Rotation", self.rotation_rad if any(self.rotation_rad) else None),
            ("Start", self.start),
        )


@dataclass(frozen=True, slots=True)
class GetConf:
    """Query the configuration of the robot, or of all sensors of a type, or of one of them."""

    WORD: ClassVar[str] = "GETCONF"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetConf:
        """Parse the message of a line."""
        return cls(
            lenient_fields.read_name(message, "Type") or "",
            lenient_fields.read_name(message, "Name"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetGeo:
    """Query the poses of sensors of a type, or of one of them; or the dimensions of the robot."""

    WORD: ClassVar[str] = "GETGEO"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetGeo:
        """Parse the message of a line."""
        return cls(
            lenient_fields.read_name(message, "Type") or "",
            lenient_fields.read_name(message, "Name"),
        )

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return lenient_fields.format_pairs(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetStartPoses:
    """Query the named start poses of the world."""

    WORD: ClassVar[str] = "GETSTARTPOSES"

    @classmethod
    def from_message(cls, message: Message) -> GetStartPoses:
        """Parse a line; its parameters, if any, are ignored."""
        return cls()

    def to_pairs(self) -> Pairs:
        """No blocks."""
        return ()


@dataclass(frozen=True, slots=True)
class Step:
    """Advance a lockstep clock. Ours: a USARSim server ignores the unknown word."""

    WORD: ClassVar[str] = "STEP"

    time_s: float

    @classmethod
    def from_message(cls, message: Message) -> Step:
        """Parse a line; without a time the step is 0 s."""
        # 0 s is a valid step: it reads the sensors without any time passing (SPEC.md 6).
        return cls(lenient_fields.read_number(message, "Time") or 0.0)

    def to_pairs(self) -> Pairs:
        """Name and value of each block of the line."""
        return (("Time", format_exact(self.time_s)),)


Command = (
    Init
    | Drive
    | DriveJoints
    | MultiDrive
    | MisPkg
    | Set
    | SetViewports
    | Trace
    | GetConf
    | GetGeo
    | GetStartPoses
    | Step
    | Note
    | ShareControl
)

# A word may have several classes: the parsers of DRIVE and SET decide by the fields.
COMMAND_PARSERS: dict[str, Callable[[Message], Command]] = {
    "INIT": Init.from_message,
    "DRIVE": drive_from_message,
    "MULTIDRIVE": MultiDrive.from_message,
    "MISPKG": MisPkg.from_message,
    # The word of UDK's later releases.
    "ACT": MisPkg.from_message,
    "SET": set_from_message,
    "TRACE": Trace.from_message,
    "GETCONF": GetConf.from_message,
    "GETGEO": GetGeo.from_message,
    "GETSTARTPOSES": GetStartPoses.from_message,
    "STEP": Step.from_message,
    "NOTE": Note.from_message,
    "SHARE": ShareControl.from_message,
}


def command_from_message(message: Message) -> Command | None:
    """Command of a message; None for one that the server ignores.

    These are an unknown word, a motion command with a number or a count beyond all limits, and a
    malformed note.
    """
    reader = COMMAND_PARSERS.get(message.word)
    try:
        return reader(message) if reader else None
    except RemoteProtocolError:
        return None


def line_from_command(command: Command) -> bytes:
    """Line of a command with its line end, numbers exact.

    Raises:
        LocalProtocolError: A text would break the line, a number is not finite, or a note is none.
    """
    return format_line(command.WORD, command.to_pairs())


def _read_location(message: Message) -> Vector3 | None:
    """Location of an INIT, or the {X} {Y} {Z} that GameBots accepts instead."""
    location = lenient_fields.read_vector(message, "Location")
    if location is not None:
        return location
    # One of the three suffices, as in GameBots; the others are 0.
    x, y, z = (lenient_fields.read_number(message, key) for key in ("X", "Y", "Z"))
    return None if x is None and y is None and z is None else (x or 0.0, y or 0.0, z or 0.0)


# All commands are imported from this module, so that a command can move between the files.
__all__ = [
    "COMMAND_PARSERS",
    "Command",
    "ControlOrder",
    "Drive",
    "DriveJoints",
    "GetConf",
    "GetGeo",
    "GetStartPoses",
    "Init",
    "JointCommand",
    "LinkCommand",
    "MisPkg",
    "MultiDrive",
    "Note",
    "Set",
    "SetViewports",
    "ShareControl",
    "Step",
    "Trace",
    "command_from_message",
    "line_from_command",
]
