"""SEN of what counts, touches and recognises: encoders, tachometers, switches, RFID, victims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect, udk_time_pairs
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.report_items import items_from_message, messages_from_items
from catoptra_protocol.usarsim.value_format import (
    Vector3,
    format_boolean,
    format_fixed_point,
    format_vector,
)


@dataclass(frozen=True, slots=True)
class EncoderReadings:
    """What encoders counted as (name, ticks). UDK prints the time, if there is one."""

    WORD: ClassVar[str] = "SEN"

    items: tuple[tuple[str, int], ...]
    time_s: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> EncoderReadings:
        """Return the readings of a parsed line, in either dialect."""
        items = items_from_message(message)
        named = (
            (strict_fields.read_text(item, "Name"), strict_fields.read_integer(item, "Tick"))
            for item in items
        )
        return cls(tuple(named), strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, or in UDK a line each."""
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "Encoder"))
        items = ((("Name", name), ("Tick", str(tick))) for name, tick in self.items)
        return messages_from_items(self.WORD, head, items, dialect)


@dataclass(frozen=True, slots=True)
class TachometerReading:
    """How fast each driven wheel spins, and what it has turned: rad/s and rad, in one order."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    velocities_rad_s: tuple[float, ...] = ()
    positions_rad: tuple[float, ...] = ()

    @classmethod
    def from_message(cls, message: Message) -> TachometerReading:
        """Return the reading of a parsed line; UDK's first one may hold no wheels."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            velocities_rad_s=_read_optional_numbers(message, "Vel"),
            positions_rad=_read_optional_numbers(message, "Pos"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        pairs = (
            ("Time", format_fixed_point(self.time_s)),
            ("Type", "Tachometer"),
            ("Name", self.name),
            ("Vel", format_vector(self.velocities_rad_s)),
            ("Pos", format_vector(self.positions_rad)),
        )
        return (Message(self.WORD, tuple(pair for pair in pairs if pair[1])),)


@dataclass(frozen=True, slots=True)
class TouchReadings:
    """What touch sensors feel as (name, touched). UDK prints the time, if there is one."""

    WORD: ClassVar[str] = "SEN"

    items: tuple[tuple[str, bool], ...]
    time_s: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> TouchReadings:
        """Return the readings of a parsed line, in either dialect."""
        items = items_from_message(message)
        named = (
            (strict_fields.read_text(item, "Name"), strict_fields.read_boolean(item, "Touch"))
            for item in items
        )
        return cls(tuple(named), strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, or in UDK a line each."""
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "Touch"))
        items = ((("Name", name), ("Touch", format_boolean(is_on))) for name, is_on in self.items)
        return messages_from_items(self.WORD, head, items, dialect)


@dataclass(frozen=True, slots=True)
class RfidReading:
    """The numbers of the tags in reach."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    ids: tuple[int, ...] = ()

    @classmethod
    def from_message(cls, message: Message) -> RfidReading:
        """Return the reading of a parsed line."""
        ids = (value for name, value in message.pairs if name.lower() == "id")
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            ids=tuple(
                strict_fields.read_integer(Message("SEN", (("ID", value),)), "ID") for value in ids
            ),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        ids = (("ID", str(number)) for number in self.ids)
        head = (("Time", format_fixed_point(self.time_s)), ("Type", "RFID"), ("Name", self.name))
        return (Message(self.WORD, (*head, *ids)),)


@dataclass(frozen=True, slots=True)
class VictimPart:
    """A part of a victim in sight, and where it is relative to the sensor."""

    name: str
    location_m: Vector3


@dataclass(frozen=True, slots=True)
class VictimReading:
    """Whether victims are in sight, and which parts of them; some servers tell no time."""

    WORD: ClassVar[str] = "SEN"

    time_s: float | None
    name: str
    status: str = "NoVictims"
    parts: tuple[VictimPart, ...] = ()

    @classmethod
    def from_message(cls, message: Message) -> VictimReading:
        """Return the reading of a parsed line: without a status if there are parts, or a name."""
        return cls(
            time_s=strict_fields.read_optional_number(message, "Time"),
            name=message.get("Name") or "",
            status=message.get("Status") or "",
            parts=tuple(_parse_victim_parts(message)),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        time = () if self.time_s is None else (("Time", format_fixed_point(self.time_s)),)
        head = (*time, ("Type", "VictSensor"), ("Name", self.name))
        status = (("Status", self.status),) if self.status else ()
        parts = (pair for part in self.parts for pair in _part_pairs(part))
        return (Message(self.WORD, (*head, *status, *parts)),)


def _read_optional_numbers(message: Message, name: str) -> tuple[float, ...]:
    return () if message.get(name) is None else strict_fields.read_numbers(message, name)


def _part_pairs(part: VictimPart) -> Pairs:
    return ("PartName", part.name), ("Location", format_vector(part.location_m, 2))


def _parse_victim_parts(message: Message) -> list[VictimPart]:
    """Return each PartName with the Location behind it."""
    names = [value for name, value in message.pairs if name.lower() == "partname"]
    places = [value for name, value in message.pairs if name.lower() == "location"]
    located = zip(names, places, strict=False)
    return [
        VictimPart(name, *strict_fields.parse_vectors(message, Location=place))
        for name, place in located
    ]
