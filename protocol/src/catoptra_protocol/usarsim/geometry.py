"""GEO, the reply to GETGEO: poses of sensors on the robot, and the dimensions of the robot.

UT2004 writes one block per item with all four pairs, UDK a block per pair; both in one line.
Positions are in the frame of the mount.
"""

from __future__ import annotations

from dataclasses import field
from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import (
    Dialect,
    Message,
    Pairs,
    items_from_message,
    messages_from_items,
)
from catoptra_protocol.usarsim.mission_package import MissionPackageGeometry
from catoptra_protocol.usarsim.value_format import (
    format_fixed_point,
    format_rounded_vector,
    format_vector,
)
from catoptra_protocol.vectors import Vector3

# Mount of items on the chassis itself, in UT2004.
CHASSIS_MOUNT = "HARD"


@dataclass(frozen=True, slots=True)
class GeometryItem:
    """Pose of one sensor in the frame of its mount."""

    name: str
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""
    mount: str = CHASSIS_MOUNT
    """Name of the part that carries the sensor; CHASSIS_MOUNT for the chassis."""

    @classmethod
    def from_message(cls, message: Message) -> GeometryItem:
        """Parse a message with the four fields of one item."""
        return cls(
            name=strict_fields.read_text(message, "Name"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
            mount=strict_fields.read_text(message, "Mount"),
        )

    def to_pairs(self) -> Pairs:
        """The four pairs of the item in UT2004."""
        return (
            ("Name", self.name),
            ("Location", format_vector(self.location_m)),
            ("Orientation", format_vector(self.rotation_rad)),
            ("Mount", self.mount),
        )

    def to_udk_pairs(self, model: str) -> Pairs:
        """The four pairs of the item in UDK, where each mount is the robot (Sensor.uc)."""
        # Rounded to centimetres: a capture has 0.21 for a configured 0.2085.
        return (
            ("Name", self.name),
            ("Location", format_rounded_vector(self.location_m)),
            ("Orientation", format_rounded_vector(self.rotation_rad)),
            ("Mount", model or self.mount),
        )


@dataclass(frozen=True, slots=True)
class Geometry:
    """All items of a type; without items the empty reply."""

    WORD: ClassVar[str] = "GEO"

    type: str
    items: tuple[GeometryItem, ...] = ()
    name: str | None = None
    """Name in the request of an empty reply."""
    model: str = field(default="", compare=False)
    """Name of the robot's model, the mount of items on the chassis in UDK; not in the line
    otherwise."""

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line: in UDK to the centimetre, and none without items."""
        type_ = ("Type", self.type)
        if dialect is Dialect.UDK:
            pairs = tuple(pair for item in self.items for pair in item.to_udk_pairs(self.model))
            return (Message(self.WORD, (type_, *pairs)),) if pairs else ()
        if not self.items:
            name_pairs = () if self.name is None else (("Name", self.name),)
            return (Message(self.WORD, (type_, *name_pairs)),)
        items = (item.to_pairs() for item in self.items)
        return messages_from_items(self.WORD, (type_,), items, dialect)


@dataclass(frozen=True, slots=True)
class VehicleGeometry:
    """Dimensions of the robot itself."""

    WORD: ClassVar[str] = "GEO"

    name: str
    """Name of the model."""
    dimensions_m: Vector3
    """Length, width, height."""
    centre_of_gravity_m: Vector3
    wheel_radius_m: float
    wheel_separation_m: float
    """Distance between left and right wheels."""
    wheel_base_m: float
    """Distance between front and rear wheels."""
    vehicle_type: str = "GroundVehicle"

    @classmethod
    def from_message(cls, message: Message) -> VehicleGeometry:
        """Parse the message of a line."""
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
        """Line of the report, the same in both dialects."""
        # No capture of UDK has this line; the common order follows GroundVehicle.uc
        # (SPEC-NOTES.md).
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
    """Parse a GEO line: of the robot, of a mission package, or of sensors."""
    # By the fields and not by the type: the type of a robot is free text, GroundVehicle or another.
    if message.get("Dimensions") is not None:
        return VehicleGeometry.from_message(message)
    if message.get("Link") is not None:
        return MissionPackageGeometry.from_message(message)
    # The empty reply may have a Name without a Location.
    located = [x for x in items_from_message(message) if x.get("Location") is not None]
    items = tuple(GeometryItem.from_message(item) for item in located)
    type_ = strict_fields.read_text(message, "Type")
    return Geometry(type_, items, name=None if items else message.get("Name"))
