"""SEN of what measures distances: range scanners and sonars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.grammar import Message
from catoptra_protocol.usarsim.report_items import items_from_message, messages_from_items
from catoptra_protocol.usarsim.value_format import (
    format_fixed_point,
    format_vector,
    truncate_to_unreal_units,
)


@dataclass(frozen=True, slots=True)
class RangeScanReading:
    """A scan: ranges from the robot's right to its left, `resolution_rad` apart, ends included."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    resolution_rad: float
    fov_rad: float
    ranges_m: tuple[float, ...]

    @classmethod
    def from_message(cls, message: Message) -> RangeScanReading:
        """Return the reading of a parsed line."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            resolution_rad=strict_fields.read_number(message, "Resolution"),
            fov_rad=strict_fields.read_number(message, "FOV"),
            ranges_m=strict_fields.read_numbers(message, "Range"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line: UT2004 has 2 decimals in Time and 4 in Range, UDK the reverse."""
        is_udk = dialect is Dialect.UDK
        resolution_rad, fov_rad = self.resolution_rad, self.fov_rad
        if is_udk:
            resolution_rad, fov_rad = (
                truncate_to_unreal_units(resolution_rad),
                truncate_to_unreal_units(fov_rad),
            )
        pairs = (
            ("Time", format_fixed_point(self.time_s, 4 if is_udk else 2)),
            ("Type", "RangeScanner"),
            ("Name", self.name),
            ("Resolution", format_fixed_point(resolution_rad)),
            ("FOV", format_fixed_point(fov_rad)),
            ("Range", format_vector(self.ranges_m, 2 if is_udk else 4)),
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
        named = (
            (strict_fields.read_text(item, "Name"), strict_fields.read_number(item, "Range"))
            for item in items
        )
        return cls(strict_fields.read_number(message, "Time"), tuple(named))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, or lines."""
        head = (("Time", format_fixed_point(self.time_s)), ("Type", "Sonar"))
        items = (
            (("Name", name), ("Range", format_fixed_point(range_m))) for name, range_m in self.items
        )
        return messages_from_items(self.WORD, head, items, dialect)
