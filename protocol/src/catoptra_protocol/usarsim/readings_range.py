"""SEN of distance sensors: range scanners and sonars."""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
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
    """A scan from the right of the robot to its left."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    resolution_rad: float
    """Angle between two ranges."""
    fov_rad: float
    """Angle from the first range to the last one."""
    ranges_m: tuple[float, ...]
    """Ranges, both ends of the field of view included."""

    @classmethod
    def from_message(cls, message: Message) -> RangeScanReading:
        """Parse the message of a line."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            resolution_rad=strict_fields.read_number(message, "Resolution"),
            fov_rad=strict_fields.read_number(message, "FOV"),
            ranges_m=strict_fields.read_numbers(message, "Range"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line: UT2004 has 2 decimals in Time and 4 in Range, UDK the reverse."""
        is_udk = dialect is Dialect.UDK
        resolution_rad, fov_rad = self.resolution_rad, self.fov_rad
        # Angles of UDK pass through whole Unreal units, as in CONF.
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
    """Ranges of all sonars of a robot."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    items: tuple[tuple[str, float], ...]
    """Pairs of name and range in metres."""

    @classmethod
    def from_message(cls, message: Message) -> SonarReadings:
        """Parse a line of either dialect."""
        # One item per line in UDK, all in one line in UT2004.
        items = items_from_message(message)
        readings = (
            (strict_fields.read_text(item, "Name"), strict_fields.read_number(item, "Range"))
            for item in items
        )
        return cls(strict_fields.read_number(message, "Time"), tuple(readings))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """One line; in UDK one line each."""
        head = (("Time", format_fixed_point(self.time_s)), ("Type", "Sonar"))
        items = (
            (("Name", name), ("Range", format_fixed_point(range_m))) for name, range_m in self.items
        )
        return messages_from_items(self.WORD, head, items, dialect)
