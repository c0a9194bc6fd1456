"""STA, the periodic status of the robot itself, every 0.2 s."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.value_format import format_boolean, format_fixed_point, is_number

# All other numeric blocks are joints: their names are those of the robot file.
_STANDARD_BLOCKS = frozenset(
    ("time", "type", "battery", "view", "frontsteer", "rearsteer", "lighttoggle", "lightintensity")
)


@dataclass(frozen=True, slots=True)
class VehicleStatus:
    """Status of a skid-steered robot."""

    WORD: ClassVar[str] = "STA"

    time_s: float
    battery_s: int
    """Whole seconds left."""
    vehicle_type: str = "GroundVehicle"
    light: bool = False
    view: int = -1
    """Tile of the robot's first camera; -1 = none."""
    joints: tuple[tuple[str, float], ...] = ()
    """Name and angle in radians of joints of the robot itself, such as flippers."""

    @classmethod
    def from_message(cls, message: Message) -> VehicleStatus:
        """Parse a line; UDK has no View. Further numeric blocks are joints."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            battery_s=strict_fields.read_integer(message, "Battery"),
            vehicle_type=strict_fields.read_text(message, "Type"),
            light=strict_fields.read_boolean(message, "LightToggle"),
            view=strict_fields.read_integer(message, "View", default=-1),
            joints=tuple(_parse_joints(message)),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        pairs = self._udk_pairs() if dialect is Dialect.UDK else self._ut2004_pairs()
        return (Message(self.WORD, pairs),)

    def _ut2004_pairs(self) -> Pairs:
        """Blocks of UT2004, each of which some client requires."""
        return (
            ("Type", self.vehicle_type),
            ("Time", format_fixed_point(self.time_s, 2)),
            # Always 0 on a skid-steered robot, but the Java client requires the blocks.
            ("FrontSteer", format_fixed_point(0.0)),
            ("RearSteer", format_fixed_point(0.0)),
            *self._joint_pairs(),
            ("LightToggle", format_boolean(self.light)),
            ("LightIntensity", "100" if self.light else "0"),
            # Integers, which the Java client parses as such.
            ("Battery", str(int(self.battery_s))),
            ("View", str(self.view)),
        )

    def _udk_pairs(self) -> Pairs:
        """Blocks of UDK."""
        return (
            ("Time", format_fixed_point(self.time_s)),
            ("Battery", str(int(self.battery_s))),
            ("Type", self.vehicle_type),
            ("LightToggle", format_boolean(self.light)),
            # Captures show 100 with the light off, too.
            ("LightIntensity", "100"),
            ("FrontSteer", "0"),
            ("RearSteer", "0"),
            *self._joint_pairs(),
        )

    def _joint_pairs(self) -> Pairs:
        return tuple((name, format_fixed_point(angle_rad)) for name, angle_rad in self.joints)


def _parse_joints(message: Message) -> Iterator[tuple[str, float]]:
    for name, value in message.pairs:
        # A further block that is no number is no joint: other servers append text.
        if name and name.lower() not in _STANDARD_BLOCKS and is_number(value):
            yield name, strict_fields.read_number(Message(message.word, ((name, value),)), name)
