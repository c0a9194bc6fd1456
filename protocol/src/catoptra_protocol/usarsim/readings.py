"""SEN, the sensor readings: those with a pose here, and the table of all.

Time comes first where a sensor has one, then Type. Fields, decimals and the number of lines depend
on the dialect.

To add a reading: its class beside similar ones (`readings_range`, `readings_encoders_and_tags`,
`readings_gps`), its entries in the `Reading` union and in READING_PARSERS, a vector in
tests/conformance/data/reports, its row in SPEC.md 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect, udk_time_pairs
from catoptra_protocol.usarsim.grammar import Message, Pairs
from catoptra_protocol.usarsim.readings_encoders_and_tags import (
    EncoderReadings,
    RfidReading,
    TachometerReading,
    TouchReadings,
    VictimPart,
    VictimReading,
)
from catoptra_protocol.usarsim.readings_gps import GpsReading
from catoptra_protocol.usarsim.readings_range import RangeScanReading, SonarReadings
from catoptra_protocol.usarsim.value_format import (
    format_fixed_point,
    format_rounded_vector,
    format_vector,
)
from catoptra_protocol.vectors import Vector3

_TWO_PI = 2.0 * math.pi


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


__all__ = [
    "EncoderReadings",
    "GpsReading",
    "GroundTruthReading",
    "InsReading",
    "OdometryReading",
    "RangeScanReading",
    "Reading",
    "RfidReading",
    "SonarReadings",
    "TachometerReading",
    "TouchReadings",
    "VictimPart",
    "VictimReading",
    "reading_from_message",
]
