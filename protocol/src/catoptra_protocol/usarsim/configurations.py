"""CONF, the reply to GETCONF: one frozen dataclass per written part, and one that reads all.

Servers write the typed ones, with the order and spelling of the dialect; clients read a
`Configuration`, free pairs by name, since servers differ in the fields they send. Mission packages:
see `mission_package`.

To add a part: its class here, its entry in the `AnyConfiguration` union of `reports`.
"""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import Dialect, Message, Pairs
from catoptra_protocol.usarsim.value_format import (
    format_boolean,
    format_fixed_point,
    truncate_to_unreal_units,
)


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
