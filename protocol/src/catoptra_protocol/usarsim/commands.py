"""What a client may ask of the control server: one frozen dataclass a command, and their table.

Here are those that spawn, ask and step; `commands_drive` moves, `commands_set` sets up. To add one:
write its class beside those most like it (word, fields, `from_message`, `blocks`), then its line in
the `Command` union and in `COMMAND_PARSERS`, and its row in `states.py`. Reading is total: what a client
left out or wrote badly becomes None, 0 or an empty text, never an error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.usarsim import lenient_fields as fields
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
from catoptra_protocol.usarsim.commands_set import Set, SetViewports, Trace, set_from_message
from catoptra_protocol.usarsim.grammar import Message, Pairs, format_line
from catoptra_protocol.usarsim.value_format import Vector3, format_exact


@dataclass(frozen=True, slots=True)
class Init:
    """Spawn a robot of a class, at a location or at a start pose; location goes before start.

    Location and rotation (roll, pitch, yaw) are in the world frame.
    """

    WORD: ClassVar[str] = "INIT"

    class_name: str
    name: str | None = None
    location_m: Vector3 | None = None
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    start: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> Init:
        """Return the command of a parsed line."""
        return cls(
            class_name=fields.read_name(message, "ClassName") or "",
            name=fields.read_name(message, "Name"),
            location_m=_read_location(message),
            rotation_rad=fields.read_vector(message, "Rotation") or (0.0, 0.0, 0.0),
            start=fields.read_name(message, "Start"),
        )

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return fields.format_pairs(
            ("ClassName", self.class_name),
            ("Name", self.name),
            ("Location", self.location_m),
            ("Rotation", self.rotation_rad if any(self.rotation_rad) else None),
            ("Start", self.start),
        )


@dataclass(frozen=True, slots=True)
class GetConf:
    """Ask for the configuration of the robot, or of the sensors of a type, or of one of them."""

    WORD: ClassVar[str] = "GETCONF"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetConf:
        """Return the command of a parsed line."""
        return cls(fields.read_name(message, "Type") or "", fields.read_name(message, "Name"))

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return fields.format_pairs(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetGeo:
    """Ask where the sensors of a type, or one of them, sit; or for the robot's dimensions."""

    WORD: ClassVar[str] = "GETGEO"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetGeo:
        """Return the command of a parsed line."""
        return cls(fields.read_name(message, "Type") or "", fields.read_name(message, "Name"))

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
        return fields.format_pairs(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetStartPoses:
    """Ask for the named start poses of the world."""

    WORD: ClassVar[str] = "GETSTARTPOSES"

    @classmethod
    def from_message(cls, message: Message) -> GetStartPoses:
        """Return the command; its parameters, if any, say nothing."""
        return cls()

    def to_pairs(self) -> Pairs:
        """Return no blocks."""
        return ()


@dataclass(frozen=True, slots=True)
class Step:
    """Advance a lockstep simulation by this time. Ours: USARSim ignores the unknown word."""

    WORD: ClassVar[str] = "STEP"

    time_s: float

    @classmethod
    def from_message(cls, message: Message) -> Step:
        """Return the command of a parsed line; without a time it asks for 0 s."""
        return cls(fields.read_number(message, "Time") or 0.0)

    def to_pairs(self) -> Pairs:
        """Return the blocks to send."""
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
)

COMMAND_PARSERS: dict[str, Callable[[Message], Command]] = {
    "INIT": Init.from_message,
    "DRIVE": drive_from_message,
    "MULTIDRIVE": MultiDrive.from_message,
    "MISPKG": MisPkg.from_message,
    "ACT": MisPkg.from_message,  # UDK's newer word for it
    "SET": set_from_message,
    "TRACE": Trace.from_message,
    "GETCONF": GetConf.from_message,
    "GETGEO": GetGeo.from_message,
    "GETSTARTPOSES": GetStartPoses.from_message,
    "STEP": Step.from_message,
}


def command_from_message(message: Message) -> Command | None:
    """Return the command of a message; None for an unknown word, which is to be ignored."""
    reader = COMMAND_PARSERS.get(message.word)
    return reader(message) if reader else None


def line_from_command(command: Command) -> bytes:
    """Return the line of a command, numbers exact. Raises LocalProtocolError if it has none."""
    return format_line(command.WORD, command.to_pairs())


def _read_location(message: Message) -> Vector3 | None:
    """Return the Location, or the {X} {Y} {Z} that GameBots takes in its place."""
    location = fields.read_vector(message, "Location")
    if location is not None:
        return location
    x, y, z = (fields.read_number(message, key) for key in ("X", "Y", "Z"))
    return None if x is None and y is None and z is None else (x or 0.0, y or 0.0, z or 0.0)


__all__ = [
    "COMMAND_PARSERS",
    "Command",
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
    "ControlOrder",
    "Set",
    "SetViewports",
    "Step",
    "Trace",
    "command_from_message",
    "line_from_command",
]
