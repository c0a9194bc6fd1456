"""GEO, the reply to GETGEO: where sensors sit on the robot, and the robot's own dimensions.

Written in the UT2004 form, one block an item that holds all four pairs; the UDK form, a block each,
is read too. Positions are in the frame of what the item is mounted on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.wire import fields
from catoptra_protocol.wire.grammar import Message, Pairs, words
from catoptra_protocol.wire.numbers import Vector, fixed, vector


@dataclass(frozen=True, slots=True)
class GeometryItem:
    """One sensor: its place (roll, pitch, yaw) in the frame of its mount; HARD is the chassis."""

    name: str
    location_m: Vector
    rotation_rad: Vector
    mount: str = "HARD"

    @classmethod
    def from_message(cls, message: Message) -> GeometryItem:
        """Return the item of a message that holds its four fields."""
        return cls(
            name=fields.text(message, "Name"),
            location_m=fields.vector(message, "Location"),
            rotation_rad=fields.vector(message, "Orientation"),
            mount=fields.text(message, "Mount"),
        )

    def pair(self) -> tuple[str, str]:
        """Return the item's one block."""
        for text in (self.name, self.mount):
            if not text or " " in text:
                raise LocalProtocolError(f"GEO: {text!r} cannot be sent: it must be one word")
        place = f"Location {vector(self.location_m)} Orientation {vector(self.rotation_rad)}"
        return "Name", f"{self.name} {place} Mount {self.mount}"


@dataclass(frozen=True, slots=True)
class Geometry:
    """All items of a type. Without items it is the empty reply, which may carry the name asked."""

    WORD: ClassVar[str] = "GEO"

    type: str
    items: tuple[GeometryItem, ...] = ()
    name: str | None = None

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        if self.items:
            return (("Type", self.type), *(item.pair() for item in self.items))
        named = () if self.name is None else (("Name", self.name),)
        return (("Type", self.type), *named)


@dataclass(frozen=True, slots=True)
class VehicleGeometry:
    """The robot itself: length, width, height; centre of gravity; wheels."""

    WORD: ClassVar[str] = "GEO"

    name: str
    dimensions_m: Vector
    cog_m: Vector
    wheel_radius_m: float
    wheel_separation_m: float
    wheel_base_m: float
    vehicle_type: str = "GroundVehicle"

    @classmethod
    def from_message(cls, message: Message) -> VehicleGeometry:
        """Return the robot's geometry of a parsed line."""
        return cls(
            name=fields.text(message, "Name"),
            dimensions_m=fields.vector(message, "Dimensions"),
            cog_m=fields.vector(message, "COG"),
            wheel_radius_m=fields.number(message, "WheelRadius"),
            wheel_separation_m=fields.number(message, "WheelSeparation"),
            wheel_base_m=fields.number(message, "WheelBase"),
            vehicle_type=fields.text(message, "Type"),
        )

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return (
            ("Type", self.vehicle_type),
            ("Name", self.name),
            ("Dimensions", vector(self.dimensions_m)),
            ("COG", vector(self.cog_m)),
            ("WheelRadius", fixed(self.wheel_radius_m)),
            ("WheelSeparation", fixed(self.wheel_separation_m)),
            ("WheelBase", fixed(self.wheel_base_m)),
        )


def geometry_from_message(message: Message) -> Geometry | VehicleGeometry | None:
    """Return what a GEO line says; None for a form that we do not know (mission packages)."""
    if message.get("Dimensions") is not None:
        return VehicleGeometry.from_message(message)
    if message.get("Link") is not None:
        return None
    type_ = fields.text(message, "Type")
    if message.get("Location") is not None:
        return Geometry(type_, (GeometryItem.from_message(message),))
    blocks = [_item_message(value) for name, value in message.pairs if name.lower() == "name"]
    placed = [block for block in blocks if block.get("Location") is not None]
    items = tuple(GeometryItem.from_message(block) for block in placed)
    return Geometry(type_, items, name=None if items else message.get("Name"))


def _item_message(value: str) -> Message:
    """Return the fields of a block `{Name N Location x,y,z ...}`, given without its `Name`."""
    name, *rest = words(value)
    return Message("GEO", (("Name", name), *zip(rest[::2], rest[1::2], strict=False)))
