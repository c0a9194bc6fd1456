"""SEN, the sensor readings: one frozen dataclass each, and their table READING_PARSERS.

Time comes first where a sensor has one, then Type. Fields, decimals and the number of lines depend
on the dialect. GPS prints degrees and minutes, as NMEA sentences do.

To add a reading: its class beside similar ones, its entries in the `Reading` union and in
READING_PARSERS, a vector in tests/conformance/data/reports, its row in SPEC.md 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar, TypeVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import (
    Dialect,
    Message,
    Pairs,
    items_from_message,
    messages_from_items,
    udk_time_pairs,
)
from catoptra_protocol.usarsim.value_format import (
    format_boolean,
    format_fixed_point,
    format_rounded_vector,
    format_vector,
    truncate_to_unreal_units,
)
from catoptra_protocol.vectors import Vector3

# A tick is 1e-4 minutes, the last printed decimal.
_TICKS_PER_DEGREE = 600_000


@dataclass(frozen=True, slots=True)
class GpsReading:
    """Position of the receiver on Earth."""

    WORD: ClassVar[str] = "SEN"

    name: str
    latitude_deg: float = 0.0
    """North is positive; 0 without a fix."""
    longitude_deg: float = 0.0
    """East is positive; 0 without a fix."""
    has_fix: bool = False
    num_satellites: int = 0
    time_s: float | None = None
    """Printed by UDK only, and there by option; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> GpsReading:
        """Parse a line.

        Raises:
            RemoteProtocolError: A field is missing or wrong; names the field.
        """
        name, satellites = (
            strict_fields.read_text(message, "Name"),
            strict_fields.read_integer(message, "Satellites"),
        )
        time_s = strict_fields.read_optional_number(message, "Time")
        if not strict_fields.read_boolean(message, "Fix"):
            return cls(name, num_satellites=satellites, time_s=time_s)
        return cls(
            name=name,
            latitude_deg=_parse_angle(message, "Latitude", "NS"),
            longitude_deg=_parse_angle(message, "Longitude", "EW"),
            has_fix=True,
            num_satellites=satellites,
            time_s=time_s,
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line, the same in both dialects except for the time."""
        position = () if not self.has_fix else self._position_pairs()
        fix = (("Fix", str(int(self.has_fix))), ("Satellites", str(self.num_satellites)))
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "GPS"), ("Name", self.name))
        return (Message(self.WORD, (*head, *position, *fix)),)

    def _position_pairs(self) -> Pairs:
        latitude = _format_angle(self.latitude_deg, "NS")
        return ("Latitude", latitude), ("Longitude", _format_angle(self.longitude_deg, "EW"))


def _format_angle(angle_deg: float, hemispheres: str) -> str:
    """Degrees, minutes and hemisphere, `39,8.0341,N`, truncated."""
    if not abs(angle_deg) <= 180.0:
        raise LocalProtocolError(f"GPS: {angle_deg!r} degrees cannot be sent: at most 180")
    # Rounded at 1e-5 of a tick before the truncation, a thousand times the noise of a double there:
    # an angle that was read prints unchanged.
    ticks = int(round(abs(angle_deg) * _TICKS_PER_DEGREE, 5))
    degrees, rest = divmod(ticks, _TICKS_PER_DEGREE)
    return f"{degrees},{rest // 10_000}.{rest % 10_000:04d},{hemispheres[angle_deg < 0.0]}"


def _parse_angle(message: Message, name: str, hemispheres: str) -> float:
    degrees, minutes, side = _split_angle(message, name)
    # Two messages with names of their own, so that an error names degrees or minutes.
    parts = Message(message.word, ((name, degrees), (f"{name}Minutes", minutes)))
    angle = (
        strict_fields.read_number(parts, name)
        + strict_fields.read_number(parts, f"{name}Minutes") / 60.0
    )
    if side not in tuple(hemispheres) or not 0.0 <= angle <= 180.0:
        raise RemoteProtocolError(
            f"SEN: {{{name} {strict_fields.read_text(message, name)[:80]}}}: "
            f"expected at most 180 degrees and one of {', '.join(hemispheres)}"
        )
    return -angle if side == hemispheres[1] else angle


def _split_angle(message: Message, name: str) -> tuple[str, str, str]:
    value = strict_fields.read_text(message, name)
    parts = value.split(",")
    if len(parts) != 3:
        raise RemoteProtocolError(
            f"SEN: {{{name} {value[:80]}}}: expected degrees,minutes,side as in 39,8.0341,N"
        )
    degrees, minutes, side = parts
    return degrees, minutes, side


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
        items = _read_items(message, "Range", strict_fields.read_number)
        return cls(strict_fields.read_number(message, "Time"), items)

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """One line; in UDK one line each."""
        head = (("Time", format_fixed_point(self.time_s)), ("Type", "Sonar"))
        items = (
            (("Name", name), ("Range", format_fixed_point(range_m))) for name, range_m in self.items
        )
        return messages_from_items(self.WORD, head, items, dialect)


_TWO_PI = 2.0 * math.pi
_ValueT = TypeVar("_ValueT")


@dataclass(frozen=True, slots=True)
class OdometryReading:
    """Pose from the wheels, relative to the spawn pose."""

    WORD: ClassVar[str] = "SEN"

    name: str
    x_m: float
    y_m: float
    yaw_rad: float
    time_s: float | None = None
    """Printed by UDK only; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> OdometryReading:
        """Parse the message of a line."""
        name, pose = (
            strict_fields.read_text(message, "Name"),
            strict_fields.read_vector(message, "Pose"),
        )
        return cls(name, *pose, time_s=strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        pose = format_vector((self.x_m, self.y_m, self.yaw_rad))
        own: Pairs = (("Type", "Odometry"), ("Name", self.name), ("Pose", pose))
        return (Message(self.WORD, (*udk_time_pairs(self.time_s, dialect), *own)),)


@dataclass(frozen=True, slots=True)
class InsReading:
    """Pose estimated by inertial navigation, in the world frame."""

    WORD: ClassVar[str] = "SEN"

    name: str
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""
    time_s: float | None = None
    """Printed by UDK only, and there by option; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> InsReading:
        """Parse the message of a line."""
        return cls(
            name=strict_fields.read_text(message, "Name"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
            time_s=strict_fields.read_optional_number(message, "Time"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report: in UDK with its time if known, rounded, with unwrapped angles."""
        if dialect is Dialect.UDK:
            location = format_rounded_vector(self.location_m)
            orientation = format_rounded_vector(self.rotation_rad)
        else:
            location = format_vector(self.location_m, 2)
            orientation = _format_angles(self.rotation_rad, 2, dialect)
        pairs = (
            *udk_time_pairs(self.time_s, dialect),
            ("Type", "INS"),
            ("Name", self.name),
            ("Location", location),
            ("Orientation", orientation),
        )
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class GroundTruthReading:
    """True pose of the robot in the world frame.

    UT2004 prints 2 decimals, a centimetre, and angles in [0, 2 pi); UDK prints 3 decimals and
    unwrapped angles. Experiments need more decimals: more are printed if configured.
    """

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""
    decimals: int = 2
    """Decimals of location and rotation; UDK prints at least 3."""

    @classmethod
    def from_message(cls, message: Message) -> GroundTruthReading:
        """Parse a line, together with its number of decimals."""
        first = strict_fields.read_text(message, "Location").partition(",")[0]
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
            # A report that was read and is written again must be the same bytes.
            decimals=len(first.partition(".")[2]),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report in a dialect."""
        # More than 3 only by configuration: experiments need millimetres and less.
        decimals = max(self.decimals, 3) if dialect is Dialect.UDK else self.decimals
        pairs = (
            ("Time", format_fixed_point(self.time_s)),
            ("Type", "GroundTruth"),
            ("Name", self.name),
            ("Location", format_vector(self.location_m, decimals)),
            ("Orientation", _format_angles(self.rotation_rad, decimals, dialect)),
        )
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class EncoderReadings:
    """Counts of all encoders of a robot."""

    WORD: ClassVar[str] = "SEN"

    items: tuple[tuple[str, int], ...]
    """Pairs of name and ticks."""
    time_s: float | None = None
    """Printed by UDK only; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> EncoderReadings:
        """Parse a line of either dialect."""
        items = _read_items(message, "Tick", strict_fields.read_integer)
        return cls(items, strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """One line for all items; in UDK one line each."""
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "Encoder"))
        items = ((("Name", name), ("Tick", str(tick))) for name, tick in self.items)
        return messages_from_items(self.WORD, head, items, dialect)


@dataclass(frozen=True, slots=True)
class TachometerReading:
    """Speed and angle of each driven wheel, both in the same order."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    velocities_rad_s: tuple[float, ...] = ()
    positions_rad: tuple[float, ...] = ()
    """Angle since spawning, unwrapped."""

    @classmethod
    def from_message(cls, message: Message) -> TachometerReading:
        """Parse a line; the first one of UDK may hold no wheels."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            velocities_rad_s=_read_optional_numbers(message, "Vel"),
            positions_rad=_read_optional_numbers(message, "Pos"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        pairs = (
            ("Time", format_fixed_point(self.time_s)),
            ("Type", "Tachometer"),
            ("Name", self.name),
            ("Vel", format_vector(self.velocities_rad_s)),
            ("Pos", format_vector(self.positions_rad)),
        )
        # Without wheels both blocks are absent, as in UDK before its clock has moved.
        return (Message(self.WORD, tuple(pair for pair in pairs if pair[1])),)


@dataclass(frozen=True, slots=True)
class TouchReadings:
    """Contacts of all touch sensors of a robot."""

    WORD: ClassVar[str] = "SEN"

    items: tuple[tuple[str, bool], ...]
    """Pairs of name and contact."""
    time_s: float | None = None
    """Printed by UDK only; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> TouchReadings:
        """Parse a line of either dialect."""
        items = _read_items(message, "Touch", strict_fields.read_boolean)
        return cls(items, strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """One line for all items; in UDK one line each."""
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "Touch"))
        items = ((("Name", name), ("Touch", format_boolean(is_on))) for name, is_on in self.items)
        return messages_from_items(self.WORD, head, items, dialect)


@dataclass(frozen=True, slots=True)
class RfidReading:
    """Tags in the range of a reader."""

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    ids: tuple[int, ...] = ()
    """Number of each tag."""

    @classmethod
    def from_message(cls, message: Message) -> RfidReading:
        """Parse the message of a line."""
        ids = (value for name, value in message.pairs if name.lower() == "id")
        # Each ID as a message of its own, so that an error names the field.
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            ids=tuple(
                strict_fields.read_integer(Message("SEN", (("ID", value),)), "ID") for value in ids
            ),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        ids = (("ID", str(number)) for number in self.ids)
        head = (("Time", format_fixed_point(self.time_s)), ("Type", "RFID"), ("Name", self.name))
        return (Message(self.WORD, (*head, *ids)),)


@dataclass(frozen=True, slots=True)
class VictimPart:
    """A visible part of a victim."""

    name: str
    location_m: Vector3
    """Position in the frame of the sensor."""


@dataclass(frozen=True, slots=True)
class VictimReading:
    """Victims in view of a sensor."""

    WORD: ClassVar[str] = "SEN"

    time_s: float | None
    """None of a server that prints no time."""
    name: str
    status: str = "NoVictims"
    """`NoVictims`, or empty where parts are listed."""
    parts: tuple[VictimPart, ...] = ()

    @classmethod
    def from_message(cls, message: Message) -> VictimReading:
        """Parse a line; status, name and time may be missing."""
        return cls(
            time_s=strict_fields.read_optional_number(message, "Time"),
            name=message.get("Name") or "",
            status=message.get("Status") or "",
            parts=tuple(_parse_victim_parts(message)),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line of the report, the same in both dialects."""
        # No capture has victims; comments in three clients agree on this form (SPEC-NOTES.md, 5).
        time = () if self.time_s is None else (("Time", format_fixed_point(self.time_s)),)
        head = (*time, ("Type", "VictSensor"), ("Name", self.name))
        status = (("Status", self.status),) if self.status else ()
        parts = (pair for part in self.parts for pair in _part_pairs(part))
        return (Message(self.WORD, (*head, *status, *parts)),)


Reading = (
    SonarReadings
    | RangeScanReading
    | InsReading
    | OdometryReading
    | EncoderReadings
    | TachometerReading
    | TouchReadings
    | RfidReading
    | VictimReading
    | GroundTruthReading
    | GpsReading
)


def reading_from_message(message: Message) -> Reading | None:
    """Reading of a SEN line; None for an unknown sensor."""
    reader = READING_PARSERS.get(strict_fields.read_text(message, "Type").lower())
    return reader(message) if reader else None


# Keys in lower case: types match in any case (SPEC.md 3).
READING_PARSERS: dict[str, Callable[[Message], Reading]] = {
    "sonar": SonarReadings.from_message,
    "rangescanner": RangeScanReading.from_message,
    "ins": InsReading.from_message,
    "odometry": OdometryReading.from_message,
    "encoder": EncoderReadings.from_message,
    "tachometer": TachometerReading.from_message,
    "touch": TouchReadings.from_message,
    "rfid": RfidReading.from_message,
    "victsensor": VictimReading.from_message,
    "groundtruth": GroundTruthReading.from_message,
    "gps": GpsReading.from_message,
}


def _format_angles(angles_rad: Vector3, decimals: int, dialect: Dialect) -> str:
    """Angles of a dialect: UT2004 in [0, 2 pi), UDK unwrapped."""
    if dialect is Dialect.UDK:
        return format_vector(angles_rad, decimals)
    # A tiny negative angle prints as 6.28, as in captures.
    return format_vector(map(_wrap_to_positive, angles_rad), decimals)


def _wrap_to_positive(angle_rad: float) -> float:
    """Angle in [0, 2 pi)."""
    wrapped = angle_rad % _TWO_PI
    # The remainder of a tiny negative angle rounds up to 2 pi itself.
    return 0.0 if wrapped >= _TWO_PI else wrapped


def _read_items(
    message: Message, field: str, read: Callable[[Message, str], _ValueT]
) -> tuple[tuple[str, _ValueT], ...]:
    """Name and value of each item: one per line in UDK, all in one line in UT2004."""
    items = items_from_message(message)
    return tuple((strict_fields.read_text(item, "Name"), read(item, field)) for item in items)


def _read_optional_numbers(message: Message, name: str) -> tuple[float, ...]:
    # UDK lists no wheels before its clock has moved.
    return () if message.get(name) is None else strict_fields.read_numbers(message, name)


def _part_pairs(part: VictimPart) -> Pairs:
    return ("PartName", part.name), ("Location", format_vector(part.location_m, 2))


def _parse_victim_parts(message: Message) -> list[VictimPart]:
    """Each PartName with the Location after it."""
    names = [value for name, value in message.pairs if name.lower() == "partname"]
    locations = [value for name, value in message.pairs if name.lower() == "location"]
    # Not strict: a part without a location is skipped.
    located = zip(names, locations, strict=False)
    return [
        VictimPart(name, *strict_fields.parse_vectors(message, Location=location))
        for name, location in located
    ]
