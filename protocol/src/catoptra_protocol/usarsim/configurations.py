"""CONF and GEO, the replies to GETCONF and GETGEO: one frozen dataclass per written part.

Servers write the typed ones, with the order and spelling of the dialect; clients read a
`Configuration`, free pairs by name, since servers differ in the fields they send. Mission packages:
see `mission_package`.

To add a part: its class here, its entry in the `AnyConfiguration` union of `reports`.

GEO has poses of sensors on the robot, and the dimensions of the robot. UT2004 writes one block per
item with all four pairs, UDK a block per pair; both in one line. Positions are in the frame of the
mount.
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
    format_boolean,
    format_fixed_point,
    format_rounded_vector,
    format_vector,
    truncate_to_unreal_units,
)
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class Configuration:
    """Free pairs after the type.

    Without pairs, or with a Name alone, it is the empty reply, which UDK does not send.
    """

    WORD: ClassVar[str] = "CONF"

    type: str
    pairs: Pairs = ()

    @classmethod
    def from_message(cls, message: Message) -> Configuration:
        """Parse the message of a line."""
        # The Type may be anywhere: UDK writes the robot's Name first.
        others = tuple(pair for pair in message.pairs if pair[0].lower() != "type")
        return cls(strict_fields.read_text(message, "Type"), others)

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report; none in UDK if empty."""
        has_content = any(name.lower() != "name" for name, _ in self.pairs)
        # UDK has no empty replies (SPEC.md 8).
        if dialect is Dialect.UDK and not has_content:
            return ()
        return (Message(self.WORD, (("Type", self.type), *self.pairs)),)

    def get(self, name: str) -> str | None:
        """Value of the first pair with this name, in any case; None if missing."""
        # By Message.get, so that names are compared in one function only.
        return Message(self.WORD, self.pairs).get(name)


@dataclass(frozen=True, slots=True)
class VehicleConfiguration:
    """The robot itself; in UDK the name precedes the type."""

    WORD: ClassVar[str] = "CONF"

    name: str
    """Name of the model."""
    mass_kg: float
    max_speed_rad_s: float
    """Of a wheel."""
    max_torque: float
    """Of a wheel, in Nm."""
    max_front_steer_rad: float = 0.0
    max_rear_steer_rad: float = 0.0
    steering_type: str = "SkidSteered"
    vehicle_type: str = "GroundVehicle"

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        type_, name = ("Type", self.vehicle_type), ("Name", self.name)
        is_udk = dialect is Dialect.UDK
        decimals = 0 if is_udk else 4
        pairs = (
            *((name, type_) if is_udk else (type_, name)),
            ("SteeringType", self.steering_type),
            ("Mass", format_fixed_point(self.mass_kg)),
            ("MaxSpeed", format_fixed_point(self.max_speed_rad_s)),
            ("MaxTorque", format_fixed_point(self.max_torque)),
            # UDK prints the steering angles as integers (vector udk_configuration).
            ("MaxFrontSteer", format_fixed_point(self.max_front_steer_rad, decimals)),
            ("MaxRearSteer", format_fixed_point(self.max_rear_steer_rad, decimals)),
        )
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class RangeScannerConfiguration:
    """A range scanner. The keys are those of UT2004: `Paning`, and `Fov` where SEN has `FOV`."""

    WORD: ClassVar[str] = "CONF"

    name: str
    max_range_m: float
    min_range_m: float
    resolution_rad: float
    fov_rad: float
    panning: bool = True
    """Whether the beam turns in yaw."""
    tilting: bool = False
    """Whether the beam turns in pitch."""

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        is_udk = dialect is Dialect.UDK
        resolution_rad, fov_rad = self.resolution_rad, self.fov_rad
        # Whole Unreal units: captures of UDK show 3.1414 for a configured 3.14159.
        if is_udk:
            resolution_rad, fov_rad = (
                truncate_to_unreal_units(resolution_rad),
                truncate_to_unreal_units(fov_rad),
            )
        return _conf_messages(
            "RangeScanner",
            self.name,
            ("MaxRange", format_fixed_point(self.max_range_m)),
            ("MinRange", format_fixed_point(self.min_range_m)),
            ("Resolution", format_fixed_point(resolution_rad)),
            ("Fov", format_fixed_point(fov_rad)),
            ("Panning" if is_udk else "Paning", format_boolean(self.panning)),
            ("Tilting", format_boolean(self.tilting)),
        )


@dataclass(frozen=True, slots=True)
class SonarConfiguration:
    """A sonar; UDK also writes the parameters of its ray casting."""

    WORD: ClassVar[str] = "CONF"

    name: str
    max_range_m: float
    min_range_m: float
    beam_angle_rad: float
    scan_interval_s: float = 0.2
    max_angle_of_incidence_rad: float = 0.1745329252  # with the next two: UDK's DefaultUSAR.ini
    """Default of this and the next two: DefaultUSAR.ini of UDK."""
    traces_per_cone: int = 16
    num_cones: int = 10

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        ranges = (
            ("MaxRange", format_fixed_point(self.max_range_m)),
            ("MinRange", format_fixed_point(self.min_range_m)),
        )
        if dialect is Dialect.UDK:
            return _conf_messages("Sonar", self.name, *ranges, *self._udk_pairs())
        return _conf_messages(
            "Sonar", self.name, *ranges, ("BeamAngle", format_fixed_point(self.beam_angle_rad))
        )

    def _udk_pairs(self) -> Pairs:
        # Keys as captured from UDK, with lower-case initials, unlike BeamAngle of UT2004.
        return (
            ("ScanInterval", format_fixed_point(self.scan_interval_s)),
            ("beamAngle", format_fixed_point(self.beam_angle_rad)),
            ("maxAngleOfIncidence", format_fixed_point(self.max_angle_of_incidence_rad)),
            ("tracesPerCone", str(self.traces_per_cone)),
            ("numberOfCones", str(self.num_cones)),
        )


@dataclass(frozen=True, slots=True)
class EncoderConfiguration:
    """An encoder."""

    WORD: ClassVar[str] = "CONF"

    name: str
    resolution_rad: float
    """Angle of a tick."""

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        return _conf_messages(
            "Encoder", self.name, ("Resolution", format_fixed_point(self.resolution_rad))
        )


@dataclass(frozen=True, slots=True)
class OdometryConfiguration:
    """An odometry sensor."""

    WORD: ClassVar[str] = "CONF"

    name: str
    scan_interval_s: float
    encoder_resolution_rad: float
    """Angle of a tick of the encoders behind it."""

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        interval = ("ScanInterval", format_fixed_point(self.scan_interval_s))
        resolution = ("EncoderResolution", format_fixed_point(self.encoder_resolution_rad))
        return _conf_messages("Odometry", self.name, interval, resolution)


@dataclass(frozen=True, slots=True)
class ScanIntervalConfiguration:
    """A sensor with a period and no further parameters: GroundTruth, INS and others."""

    WORD: ClassVar[str] = "CONF"

    type: str
    name: str
    scan_interval_s: float

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        # Two decimals in UT2004, though an odometry sensor has four (vector configuration_sensors).
        decimals = 4 if dialect is Dialect.UDK else 2
        interval = ("ScanInterval", format_fixed_point(self.scan_interval_s, decimals))
        return _conf_messages(self.type, self.name, interval)


@dataclass(frozen=True, slots=True)
class TouchConfiguration:
    """A touch sensor."""

    WORD: ClassVar[str] = "CONF"

    name: str
    diameter_m: float

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        return _conf_messages("Touch", self.name, ("Diameter", format_fixed_point(self.diameter_m)))


@dataclass(frozen=True, slots=True)
class TextureRegion:
    """Rectangle of a camera in the image-port picture, in pixels."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class CameraConfiguration:
    """A camera."""

    WORD: ClassVar[str] = "CONF"

    name: str
    default_fov_deg: float
    min_fov_deg: float
    max_fov_deg: float
    fov_deg: float
    texture_region: TextureRegion | None = None
    """Tile of the camera, written in UDK only; None without tiles."""
    extra_pairs: Pairs = ()
    """Further pairs: our camera model."""

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        # UT2004 has no block for a tile; its clients find the number of the tile in View of STA.
        region = self.texture_region if dialect is Dialect.UDK else None
        tile = () if region is None else _texture_region_pairs(region)
        # The region goes between name and fields of view: clients of UDK find blocks by their
        # position.
        return _conf_messages("Camera", self.name, *tile, *self._fov_pairs(), *self.extra_pairs)

    def _fov_pairs(self) -> Pairs:
        return (
            ("CameraDefFov", format_fixed_point(self.default_fov_deg)),
            ("CameraMinFov", format_fixed_point(self.min_fov_deg)),
            ("CameraMaxFov", format_fixed_point(self.max_fov_deg)),
            ("CameraFov", format_fixed_point(self.fov_deg)),
        )


def _conf_messages(type_: str, name: str, *pairs: tuple[str, str]) -> tuple[Message, ...]:
    # The Name is the second block of every part, so that a client can match replies to requests.
    return (Message("CONF", (("Type", type_), ("Name", name), *pairs)),)


def _texture_region_pairs(region: TextureRegion) -> Pairs:
    return (
        ("TextureOffsetX", str(region.x)),
        ("TextureOffsetY", str(region.y)),
        ("TextureResolutionX", str(region.width)),
        ("TextureResolutionY", str(region.height)),
    )


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
