"""What a client may ask of the control server: one frozen dataclass a command.

To add one: write its class beside the others (word, fields, `from_message`, `blocks`), then its
line in the `Command` union and in `COMMANDS`, and its row in `states.py`. Reading is total: what a
client left out or wrote badly becomes None, 0 or an empty text, never an error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.wire.grammar import Message, Pairs, format_line
from catoptra_protocol.wire.limits import MAX_NAME_CHARS
from catoptra_protocol.wire.numbers import (
    Vector,
    boolean_from_text,
    exact,
    number_from_text,
    vector_from_text,
)


@dataclass(frozen=True, slots=True)
class Init:
    """Spawn a robot of a class, at a location or at a start pose; location goes before start.

    Location and rotation (roll, pitch, yaw) are in the world frame.
    """

    WORD: ClassVar[str] = "INIT"

    class_name: str
    name: str | None = None
    location_m: Vector | None = None
    rotation_rad: Vector = (0.0, 0.0, 0.0)
    start: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> Init:
        """Return the command of a parsed line."""
        rotation = message.get("Rotation")
        return cls(
            class_name=_name(message, "ClassName") or "",
            name=_name(message, "Name"),
            location_m=_location(message),
            rotation_rad=(0.0, 0.0, 0.0) if rotation is None else vector_from_text(rotation),
            start=_name(message, "Start"),
        )

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return _given(
            ("ClassName", self.class_name),
            ("Name", self.name),
            ("Location", None if self.location_m is None else _vector(self.location_m)),
            ("Rotation", _vector(self.rotation_rad) if any(self.rotation_rad) else None),
            ("Start", self.start),
        )


@dataclass(frozen=True, slots=True)
class Drive:
    """Set the wheel speeds of a skid-steered robot, in rad/s, or in percent if normalized.

    None leaves a side, the light or the flipping as it is.
    """

    WORD: ClassVar[str] = "DRIVE"

    left: float | None = None
    right: float | None = None
    normalized: bool = False
    light: bool | None = None
    flip: bool | None = None

    @classmethod
    def from_message(cls, message: Message) -> Drive:
        """Return the command of a parsed line."""
        return cls(
            left=_number(message, "Left"),
            right=_number(message, "Right"),
            normalized=_boolean(message, "Normalized") or False,
            light=_boolean(message, "Light"),
            flip=_boolean(message, "Flip"),
        )

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return _given(
            ("Left", None if self.left is None else exact(self.left)),
            ("Right", None if self.right is None else exact(self.right)),
            ("Normalized", _lower(self.normalized or None)),
            ("Light", _lower(self.light)),
            ("Flip", _lower(self.flip)),
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
        return cls(_name(message, "Type") or "", _name(message, "Name"))

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return _given(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetGeo:
    """Ask where the sensors of a type, or one of them, sit; or for the robot's dimensions."""

    WORD: ClassVar[str] = "GETGEO"

    type: str
    name: str | None = None

    @classmethod
    def from_message(cls, message: Message) -> GetGeo:
        """Return the command of a parsed line."""
        return cls(_name(message, "Type") or "", _name(message, "Name"))

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return _given(("Type", self.type), ("Name", self.name))


@dataclass(frozen=True, slots=True)
class GetStartPoses:
    """Ask for the named start poses of the world."""

    WORD: ClassVar[str] = "GETSTARTPOSES"

    @classmethod
    def from_message(cls, message: Message) -> GetStartPoses:
        """Return the command; its parameters, if any, say nothing."""
        return cls()

    def blocks(self) -> Pairs:
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
        return cls(_number(message, "Time") or 0.0)

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return (("Time", exact(self.time_s)),)


Command = Init | Drive | GetConf | GetGeo | GetStartPoses | Step

COMMANDS: dict[str, type[Command]] = {
    Init.WORD: Init,
    Drive.WORD: Drive,
    GetConf.WORD: GetConf,
    GetGeo.WORD: GetGeo,
    GetStartPoses.WORD: GetStartPoses,
    Step.WORD: Step,
}


def command_from_message(message: Message) -> Command | None:
    """Return the command of a message; None for an unknown word, which is to be ignored."""
    form = COMMANDS.get(message.word)
    return form.from_message(message) if form else None


def line_from_command(command: Command) -> bytes:
    """Return the line of a command, numbers exact. Raises LocalProtocolError if it has none."""
    return format_line(command.WORD, command.blocks())


def _name(message: Message, key: str) -> str | None:
    """Return a name short enough to be echoed; None if it is missing or empty."""
    return (message.get(key) or "")[:MAX_NAME_CHARS] or None


def _number(message: Message, key: str) -> float | None:
    text = message.get(key)
    return None if text is None else number_from_text(text)


def _boolean(message: Message, key: str) -> bool | None:
    text = message.get(key)
    return None if text is None else boolean_from_text(text)


def _location(message: Message) -> Vector | None:
    """Return the Location, or the {X} {Y} {Z} that GameBots takes in its place."""
    text = message.get("Location")
    if text is not None:
        return vector_from_text(text)
    x, y, z = (_number(message, key) for key in ("X", "Y", "Z"))
    return None if x is None and y is None and z is None else (x or 0.0, y or 0.0, z or 0.0)


def _given(*pairs: tuple[str, str | None]) -> Pairs:
    return tuple((name, value) for name, value in pairs if value is not None)


def _vector(values: Vector) -> str:
    return ",".join(map(exact, values))


def _lower(value: bool | None) -> str | None:
    """Return a boolean as UDK's exact comparison wants it."""
    return None if value is None else str(value).lower()
