"""SEN: what the robot's sensors read; here those that tell a pose, and the table of all.

To add one: write its class beside those most like it (`readings_range`, `readings_items`,
`readings_gps`), then its line in the `Reading` union and in `_SENSORS`. Time comes first where a
sensor has it, then Type. The form is the dialect's: fields, decimals, one line or one an item.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

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
from catoptra_protocol.usarsim.value_format import Vector3, format_fixed_point, format_vector

_TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class OdometryReading:
    """The pose that the wheels tell, relative to the spawn pose.

    UDK prints its time, if there is one; UT2004 never does.
    """

    WORD: ClassVar[str] = "SEN"

    name: str
    x_m: float
    y_m: float
    yaw_rad: float
    time_s: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> OdometryReading:
        """Return the reading of a parsed line."""
        name, pose = (
            strict_fields.read_text(message, "Name"),
            strict_fields.read_vector(message, "Pose"),
        )
        return cls(name, *pose, time_s=strict_fields.read_optional_number(message, "Time"))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line."""
        pose = format_vector((self.x_m, self.y_m, self.yaw_rad))
        own: Pairs = (("Type", "Odometry"), ("Name", self.name), ("Pose", pose))
        return (Message(self.WORD, (*udk_time_pairs(self.time_s, dialect), *own)),)


@dataclass(frozen=True, slots=True)
class InsReading:
    """The pose that inertial navigation believes in, in the world frame.

    UDK prints its time, if there is one: by default there is none.
    """

    WORD: ClassVar[str] = "SEN"

    name: str
    location_m: Vector3
    rotation_rad: Vector3
    time_s: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> InsReading:
        """Return the reading of a parsed line."""
        return cls(
            name=strict_fields.read_text(message, "Name"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
            time_s=strict_fields.read_optional_number(message, "Time"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects but for time and the range of the angles."""
        pairs = (
            *udk_time_pairs(self.time_s, dialect),
            ("Type", "INS"),
            ("Name", self.name),
            ("Location", format_vector(self.location_m, 2)),
            ("Orientation", _format_angles(self.rotation_rad, 2, dialect)),
        )
        return (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class GroundTruthReading:
    """The true pose of the robot in the world frame.

    UT2004 prints 2 decimals, a centimetre, and angles in [0, 2 pi); UDK prints 3 decimals and the
    angles as they are. Experiments need more decimals, so more are printed if given.
    """

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    location_m: Vector3
    rotation_rad: Vector3
    decimals: int = 2

    @classmethod
    def from_message(cls, message: Message) -> GroundTruthReading:
        """Return the reading of a parsed line, with the number of decimals that it shows."""
        first = strict_fields.read_text(message, "Location").partition(",")[0]
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=strict_fields.read_text(message, "Name"),
            location_m=strict_fields.read_vector(message, "Location"),
            rotation_rad=strict_fields.read_vector(message, "Orientation"),
            decimals=len(first.partition(".")[2]),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line."""
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
    """Return the reading of a SEN line; None for a sensor that we do not know."""
    reader = _READING_PARSERS.get(strict_fields.read_text(message, "Type").lower())
    return reader(message) if reader else None


_READING_PARSERS: dict[str, Callable[[Message], Reading]] = {
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
    """Return the angles as a dialect prints them: UT2004 in [0, 2 pi), UDK as they are."""
    if dialect is Dialect.UDK:
        return format_vector(angles_rad, decimals)
    return format_vector(map(_wrap_to_positive, angles_rad), decimals)


def _wrap_to_positive(angle_rad: float) -> float:
    """Return the angle in [0, 2 pi): the remainder of a tiny negative one rounds up to 2 pi."""
    wrapped = angle_rad % _TWO_PI
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
