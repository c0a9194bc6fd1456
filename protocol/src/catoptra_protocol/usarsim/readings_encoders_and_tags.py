"""SEN of encoders, tachometers, touch sensors, RFID readers and victim sensors."""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import (
    Dialect,
    Message,
    Pairs,
    items_from_message,
    messages_from_items,
    udk_time_pairs,
)
from catoptra_protocol.usarsim.value_format import (
    format_boolean,
    format_fixed_point,
    format_vector,
)
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class EncoderReadings:
    """Counts of all encoders of a robot."""

    WORD: ClassVar[str] = "SEN"

    items: tuple[tuple[str, int], ...]
    """Pairs of name and ticks."""
    time_s: float | None = None
    """Printed by UDK only; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> EncoderReadings:
        """Parse a line of either dialect."""
        items = items_from_message(message)
        readings = (
            (strict_fields.read_text(item, "Name"), strict_fields.read_integer(item, "Tick"))
            for item in items
        )
        return cls(tuple(readings), strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """One line for all items; in UDK one line each."""
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "Encoder"))
        items = ((("Name", name), ("Tick", str(tick))) for name, tick in self.items)
        return messages_from_items(self.WORD, head, items, dialect)


@dataclass(frozen=True, slots=True)
class TachometerReading:
    """Speed and angle of each driven wheel, both in the same order."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    velocities_rad_s: tuple[float, ...] = ()
    positions_rad: tuple[float, ...] = ()
    """Angle since spawning, unwrapped."""

    @classmethod
    def from_message(cls, message: Message) -> TachometerReading:
        """Parse a line; the first one of UDK may hold no wheels."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            velocities_rad_s=_read_optional_numbers(message, "Vel"),
            positions_rad=_read_optional_numbers(message, "Pos"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        pairs = (
            ("Time", format_fixed_point(self.time_s)),
            ("Type", "Tachometer"),
            ("Name", self.name),
            ("Vel", format_vector(self.velocities_rad_s)),
            ("Pos", format_vector(self.positions_rad)),
        )
        # Without wheels both blocks are absent, as in UDK before its clock has moved.
        return (Message(self.WORD, tuple(pair for pair in pairs if pair[1])),)


@dataclass(frozen=True, slots=True)
class TouchReadings:
    """Contacts of all touch sensors of a robot."""

    WORD: ClassVar[str] = "SEN"

    items: tuple[tuple[str, bool], ...]
    """Pairs of name and contact."""
    time_s: float | None = None
    """Printed by UDK only; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> TouchReadings:
        """Parse a line of either dialect."""
        items = items_from_message(message)
        readings = (
            (strict_fields.read_text(item, "Name"), strict_fields.read_boolean(item, "Touch"))
            for item in items
        )
        return cls(tuple(readings), strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """One line for all items; in UDK one line each."""
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "Touch"))
        items = ((("Name", name), ("Touch", format_boolean(is_on))) for name, is_on in self.items)
        return messages_from_items(self.WORD, head, items, dialect)


@dataclass(frozen=True, slots=True)
class RfidReading:
    """Tags in the range of a reader."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    ids: tuple[int, ...] = ()
    """Number of each tag."""

    @classmethod
    def from_message(cls, message: Message) -> RfidReading:
        """Parse the message of a line."""
        ids = (value for name, value in message.pairs if name.lower() == "id")
        # Each ID as a message of its own, so that an error names the field.
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            ids=tuple(
                strict_fields.read_integer(Message("SEN", (("ID", value),)), "ID") for value in ids
            ),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        ids = (("ID", str(number)) for number in self.ids)
        head = (("Time", format_fixed_point(self.time_s)), ("Type", "RFID"), ("Name", self.name))
        return (Message(self.WORD, (*head, *ids)),)


@dataclass(frozen=True, slots=True)
class VictimPart:
    """A visible part of a victim."""

    name: str
    location_m: Vector3
    """Position in the frame of the sensor."""


@dataclass(frozen=True, slots=True)
class VictimReading:
    """Victims in view of a sensor."""

    WORD: ClassVar[str] = "SEN"

    time_s: float | None
    """None of a server that prints no time."""
    name: str
    status: str = "NoVictims"
    """`NoVictims`, or empty where parts are listed."""
    parts: tuple[VictimPart, ...] = ()

    @classmethod
    def from_message(cls, message: Message) -> VictimReading:
        """Parse a line; status, name and time may be missing."""
        return cls(
            time_s=strict_fields.read_optional_number(message, "Time"),
            name=message.get("Name") or "",
            status=message.get("Status") or "",
            parts=tuple(_parse_victim_parts(message)),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        # No capture has victims; comments in three clients agree on this form (SPEC-NOTES.md, 5).
        time = () if self.time_s is None else (("Time", format_fixed_point(self.time_s)),)
        head = (*time, ("Type", "VictSensor"), ("Name", self.name))
        status = (("Status", self.status),) if self.status else ()
        parts = (pair for part in self.parts for pair in _part_pairs(part))
        return (Message(self.WORD, (*head, *status, *parts)),)


def _read_optional_numbers(message: Message, name: str) -> tuple[float, ...]:
    # UDK lists no wheels before its clock has moved.
    return () if message.get(name) is None else strict_fields.read_numbers(message, name)


def _part_pairs(part: VictimPart) -> Pairs:
    return ("PartName", part.name), ("Location", format_vector(part.location_m, 2))


def _parse_victim_parts(message: Message) -> list[VictimPart]:
    """Each PartName with the Location after it."""
    names = [value for name, value in message.pairs if name.lower() == "partname"]
    locations = [value for name, value in message.pairs if name.lower() == "location"]
    # Not strict: a part without a location is skipped.
    located = zip(names, locations, strict=False)
    return [
        VictimPart(name, *strict_fields.parse_vectors(message, Location=location))
        for name, location in located
    ]
