"""SEN of what measures distances: range scanners and sonars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.wire import fields
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.grammar import Message
from catoptra_protocol.wire.items import items_from_message, messages_from_items
from catoptra_protocol.wire.numbers import fixed, unreal_angle, vector


@dataclass(frozen=True, slots=True)
class RangeScan:
    """A scan: ranges from the robot's right to its left, `resolution_rad` apart, ends included."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    resolution_rad: float
    fov_rad: float
    ranges_m: tuple[float, ...]

    @classmethod
    def from_message(cls, message: Message) -> RangeScan:
        """Return the reading of a parsed line."""
        return cls(
            time_s=fields.number(message, "Time"),
            name=fields.text(message, "Name"),
            resolution_rad=fields.number(message, "Resolution"),
            fov_rad=fields.number(message, "FOV"),
            ranges_m=fields.numbers(message, "Range"),
        )

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line: UT2004 has 2 decimals in Time and 4 in Range, UDK the reverse."""
        is_udk = dialect is Dialect.UDK
        resolution_rad, fov_rad = self.resolution_rad, self.fov_rad
        if is_udk:
            resolution_rad, fov_rad = unreal_angle(resolution_rad), unreal_angle(fov_rad)
        pairs = (
            ("Time", fixed(self.time_s, 4 if is_udk else 2)),
            ("Type", "RangeScanner"),
            ("Name", self.name),
            ("Resolution", fixed(resolution_rad)),
            ("FOV", fixed(fov_rad)),
            ("Range", vector(self.ranges_m, 2 if is_udk else 4)),
        )
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class SonarReadings:
    """The ranges of sonars as (name, range in metres): all in one line, or in UDK a line each."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    items: tuple[tuple[str, float], ...]

    @classmethod
    def from_message(cls, message: Message) -> SonarReadings:
        """Return the readings of a parsed line, in either dialect."""
        items = items_from_message(message)
        named = ((fields.text(item, "Name"), fields.number(item, "Range")) for item in items)
        return cls(fields.number(message, "Time"), tuple(named))

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, or lines."""
        head = (("Time", fixed(self.time_s)), ("Type", "Sonar"))
        items = ((("Name", name), ("Range", fixed(range_m))) for name, range_m in self.items)
        return messages_from_items(self.WORD, head, items, dialect)
