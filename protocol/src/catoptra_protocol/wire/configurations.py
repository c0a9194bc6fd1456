"""CONF, the reply to GETCONF: one frozen dataclass a part that is written, one that reads all.

Servers write the typed ones, whose order and spelling are the dialect's; clients read a
`Configuration`, free pairs by name, since servers differ in what they tell. Mission packages: see
`mission_package`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.wire import fields
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.grammar import Message, Pairs
from catoptra_protocol.wire.numbers import boolean, fixed, unreal_angle


@dataclass(frozen=True, slots=True)
class Configuration:
    """Free pairs after the type. None, or a name alone, is the empty reply: silence in UDK."""

    WORD: ClassVar[str] = "CONF"

    type: str
    pairs: Pairs = ()

    @classmethod
    def from_message(cls, message: Message) -> Configuration:
        """Return the configuration of a parsed line."""
        others = tuple(pair for pair in message.pairs if pair[0].lower() != "type")
        return cls(fields.text(message, "Type"), others)

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line; none in UDK if it says nothing."""
        says_something = any(name.lower() != "name" for name, _ in self.pairs)
        if dialect is Dialect.UDK and not says_something:
            return ()
        return (Message(self.WORD, (("Type", self.type), *self.pairs)),)

    def get(self, name: str) -> str | None:
        """Return the value of the first pair with this name, in any case; None if there is none."""
        return Message(self.WORD, self.pairs).get(name)


@dataclass(frozen=True, slots=True)
class VehicleConfiguration:
    """The robot itself; the name is that of its model. UDK tells the name before the type."""

    WORD: ClassVar[str] = "CONF"

    name: str
    mass_kg: float
    max_speed_rad_s: float
    max_torque: float
    max_front_steer_rad: float = 0.0
    max_rear_steer_rad: float = 0.0
    steering_type: str = "SkidSteered"
    vehicle_type: str = "GroundVehicle"

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line."""
        type_, name = ("Type", self.vehicle_type), ("Name", self.name)
        is_udk = dialect is Dialect.UDK
        decimals = 0 if is_udk else 4
        pairs = (
            *((name, type_) if is_udk else (type_, name)),
            ("SteeringType", self.steering_type),
            ("Mass", fixed(self.mass_kg)),
            ("MaxSpeed", fixed(self.max_speed_rad_s)),
            ("MaxTorque", fixed(self.max_torque)),
            ("MaxFrontSteer", fixed(self.max_front_steer_rad, decimals)),
            ("MaxRearSteer", fixed(self.max_rear_steer_rad, decimals)),
        )
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class RangeScannerConfiguration:
    """A range scanner. The keys are UT2004's own: `Paning`, and `Fov` where SEN has `FOV`."""

    WORD: ClassVar[str] = "CONF"

    name: str
    max_range_m: float
    min_range_m: float
    resolution_rad: float
    fov_rad: float
    panning: bool = True
    tilting: bool = False

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line."""
        is_udk = dialect is Dialect.UDK
        resolution_rad, fov_rad = self.resolution_rad, self.fov_rad
        if is_udk:
            resolution_rad, fov_rad = unreal_angle(resolution_rad), unreal_angle(fov_rad)
        return _conf(
            "RangeScanner",
            self.name,
            ("MaxRange", fixed(self.max_range_m)),
            ("MinRange", fixed(self.min_range_m)),
            ("Resolution", fixed(resolution_rad)),
            ("Fov", fixed(fov_rad)),
            ("Panning" if is_udk else "Paning", boolean(self.panning)),
            ("Tilting", boolean(self.tilting)),
        )


@dataclass(frozen=True, slots=True)
class SonarConfiguration:
    """A sonar; UDK tells how it is traced too."""

    WORD: ClassVar[str] = "CONF"

    name: str
    max_range_m: float
    min_range_m: float
    beam_angle_rad: float
    scan_interval_s: float = 0.2
    max_angle_of_incidence_rad: float = 0.1745329252  # with the next two: UDK's DefaultUSAR.ini
    traces_per_cone: int = 16
    number_of_cones: int = 10

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line."""
        ranges = (("MaxRange", fixed(self.max_range_m)), ("MinRange", fixed(self.min_range_m)))
        if dialect is Dialect.UDK:
            return _conf("Sonar", self.name, *ranges, *self._udk())
        return _conf("Sonar", self.name, *ranges, ("BeamAngle", fixed(self.beam_angle_rad)))

    def _udk(self) -> Pairs:
        return (
            ("ScanInterval", fixed(self.scan_interval_s)),
            ("beamAngle", fixed(self.beam_angle_rad)),
            ("maxAngleOfIncidence", fixed(self.max_angle_of_incidence_rad)),
            ("tracesPerCone", str(self.traces_per_cone)),
            ("numberOfCones", str(self.number_of_cones)),
        )


@dataclass(frozen=True, slots=True)
class EncoderConfiguration:
    """An encoder: the angle of a tick."""

    WORD: ClassVar[str] = "CONF"

    name: str
    resolution_rad: float

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        return _conf("Encoder", self.name, ("Resolution", fixed(self.resolution_rad)))


@dataclass(frozen=True, slots=True)
class OdometryConfiguration:
    """Odometry: its period, and the angle of a tick of the encoders behind it."""

    WORD: ClassVar[str] = "CONF"

    name: str
    scan_interval_s: float
    encoder_resolution_rad: float

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        interval = ("ScanInterval", fixed(self.scan_interval_s))
        resolution = ("EncoderResolution", fixed(self.encoder_resolution_rad))
        return _conf("Odometry", self.name, interval, resolution)


@dataclass(frozen=True, slots=True)
class IntervalConfiguration:
    """A sensor of which only the period is told: GroundTruth, INS and whatever has no more."""

    WORD: ClassVar[str] = "CONF"

    type: str
    name: str
    scan_interval_s: float

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        return _conf(self.type, self.name, ("ScanInterval", fixed(self.scan_interval_s, 2)))


@dataclass(frozen=True, slots=True)
class TouchConfiguration:
    """A touch sensor: its size."""

    WORD: ClassVar[str] = "CONF"

    name: str
    diameter_m: float

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects."""
        return _conf("Touch", self.name, ("Diameter", fixed(self.diameter_m)))


@dataclass(frozen=True, slots=True)
class Tile:
    """Where a camera's picture lies in the picture that is served, in pixels."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class CameraConfiguration:
    """A camera: fields of view in degrees, its tile (UDK) and further pairs (our camera law)."""

    WORD: ClassVar[str] = "CONF"

    name: str
    default_fov_deg: float
    min_fov_deg: float
    max_fov_deg: float
    fov_deg: float
    tile: Tile | None = None
    others: Pairs = ()

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line."""
        is_tiled = dialect is Dialect.UDK and self.tile is not None
        tile = _tile_pairs(self.tile) if is_tiled and self.tile else ()
        return _conf("Camera", self.name, *tile, *self._fovs(), *self.others)

    def _fovs(self) -> Pairs:
        return (
            ("CameraDefFov", fixed(self.default_fov_deg)),
            ("CameraMinFov", fixed(self.min_fov_deg)),
            ("CameraMaxFov", fixed(self.max_fov_deg)),
            ("CameraFov", fixed(self.fov_deg)),
        )


def _conf(type_: str, name: str, *pairs: tuple[str, str]) -> tuple[Message, ...]:
    return (Message("CONF", (("Type", type_), ("Name", name), *pairs)),)


def _tile_pairs(tile: Tile) -> Pairs:
    return (
        ("TextureOffsetX", str(tile.x)),
        ("TextureOffsetY", str(tile.y)),
        ("TextureResolutionX", str(tile.width)),
        ("TextureResolutionY", str(tile.height)),
    )
