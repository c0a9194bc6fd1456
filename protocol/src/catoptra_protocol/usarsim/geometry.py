"""GEO, the reply to GETGEO: where sensors sit on the robot, and the robot's own dimensions.

UT2004 writes one block an item that holds all four pairs, UDK a block a pair; both one line.
Positions are in the frame of what the item is mounted on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.mission_package import MissionPackageGeometry
from catoptra_protocol.usarsim.report_items import items_from_message, messages_from_items
from catoptra_protocol.usarsim.value_format import Vector3, format_fixed_point, format_vector


@dataclass(frozen=True, slots=True)
class GeometryItem:
    """One sensor: its place (roll, pitch, yaw) in the frame of its mount; HARD is the chassis."""

    name: str
    location_m: Vector3
    rotation_rad: Vector3
    mount: str = "HARD"

    @classmethod
    def from_message(cls, message: Message) -> GeometryItem:
        """Return the item of a message that holds its four fields."""
        return cls(
            name=strict_fields.read_text(message, "Name"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
            mount=strict_fields.read_text(message, "Mount"),
        )

    def to_pairs(self, decimals: int) -> Pairs:
        """Return the item's four pairs."""
        return (
            ("Name", self.name),
            ("Location", format_vector(self.location_m, decimals)),
            ("Orientation", format_vector(self.rotation_rad, decimals)),
            ("Mount", self.mount),
        )


@dataclass(frozen=True, slots=True)
class Geometry:
    """All items of a type. Without items it is the empty reply, which may carry the name asked."""

    WORD: ClassVar[str] = "GEO"

    type: str
    items: tuple[GeometryItem, ...] = ()
    name: str | None = None

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line: in UDK to the centimetre, and none without items."""
        type_ = ("Type", self.type)
        if dialect is Dialect.UDK:
            pairs = tuple(pair for item in self.items for pair in item.to_pairs(2))
            return (Message(self.WORD, (type_, *pairs)),) if pairs else ()
        if not self.items:
            named = () if self.name is None else (("Name", self.name),)
            return (Message(self.WORD, (type_, *named)),)
        items = (item.to_pairs(4) for item in self.items)
        return messages_from_items(self.WORD, (type_,), items, dialect)


@dataclass(frozen=True, slots=True)
class VehicleGeometry:
    """The robot itself: length, width, height; centre of gravity; wheels."""

    WORD: ClassVar[str] = "GEO"

    name: str
    dimensions_m: Vector3
    centre_of_gravity_m: Vector3
    wheel_radius_m: float
    wheel_separation_m: float
    wheel_base_m: float
    vehicle_type: str = "GroundVehicle"

    @classmethod
    def from_message(cls, message: Message) -> VehicleGeometry:
        """Return the robot's geometry of a parsed line."""
        return cls(
            name=strict_fields.read_text(message, "Name"),
            dimensions_m=strict_fields.read_vector(message, "Dimensions"),
            centre_of_gravity_m=strict_fields.read_vector(message, "COG"),
            wheel_radius_m=strict_fields.read_number(message, "WheelRadius"),
            wheel_separation_m=strict_fields.read_number(message, "WheelSeparation"),
            wheel_base_m=strict_fields.read_number(message, "WheelBase"),
            vehicle_type=strict_fields.read_text(message, "Type"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        pairs = (
            ("Type", self.vehicle_type),
            ("Name", self.name),
            ("Dimensions", format_vector(self.dimensions_m)),
            ("COG", format_vector(self.centre_of_gravity_m)),
            ("WheelRadius", format_fixed_point(self.wheel_radius_m)),
            ("WheelSeparation", format_fixed_point(self.wheel_separation_m)),
            ("WheelBase", format_fixed_point(self.wheel_base_m)),
        )
        return (Message(self.WORD, pairs),)


def geometry_from_message(
    message: Message,
) -> Geometry | VehicleGeometry | MissionPackageGeometry:
    """Return what a GEO line says."""
    if message.get("Dimensions") is not None:
        return VehicleGeometry.from_message(message)
    if message.get("Link") is not None:
        return MissionPackageGeometry.from_message(message)
    placed = [x for x in items_from_message(message) if x.get("Location") is not None]
    items = tuple(GeometryItem.from_message(item) for item in placed)
    type_ = strict_fields.read_text(message, "Type")
    return Geometry(type_, items, name=None if items else message.get("Name"))
