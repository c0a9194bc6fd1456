"""SEN: what the robot's sensors read, one frozen dataclass a sensor.

To add one: write its class beside the others, then its line in `_SENSORS` and in the `Report` union
of `reports`. Time comes first where a sensor has it, then Type.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.wire import fields
from catoptra_protocol.wire.grammar import Message, Pairs
from catoptra_protocol.wire.numbers import Vector, fixed, vector

_TWO_PI = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class OdometryReading:
    """The pose that the wheels tell, relative to the spawn pose. It carries no time."""

    WORD: ClassVar[str] = "SEN"

    name: str
    x_m: float
    y_m: float
    yaw_rad: float

    @classmethod
    def from_message(cls, message: Message) -> OdometryReading:
        """Return the reading of a parsed line."""
        return cls(fields.text(message, "Name"), *fields.vector(message, "Pose"))

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        pose = vector((self.x_m, self.y_m, self.yaw_rad))
        return ("Type", "Odometry"), ("Name", self.name), ("Pose", pose)


@dataclass(frozen=True, slots=True)
class GroundTruthReading:
    """The true pose of the robot in the world frame; roll, pitch, yaw are sent in [0, 2 pi).

    UT2004 prints 2 decimals, a centimetre; experiments need more.
    """

    WORD: ClassVar[str] = "SEN"

    time_s: float
    name: str
    location_m: Vector
    rotation_rad: Vector
    decimals: int = 2

    @classmethod
    def from_message(cls, message: Message) -> GroundTruthReading:
        """Return the reading of a parsed line, with the number of decimals that it shows."""
        first = fields.text(message, "Location").partition(",")[0]
        return cls(
            time_s=fields.number(message, "Time"),
            name=fields.text(message, "Name"),
            location_m=fields.vector(message, "Location"),
            rotation_rad=fields.vector(message, "Orientation"),
            decimals=len(first.partition(".")[2]),
        )

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        angles = [_positive_angle(angle) for angle in self.rotation_rad]
        return (
            ("Time", fixed(self.time_s)),
            ("Type", "GroundTruth"),
            ("Name", self.name),
            ("Location", vector(self.location_m, self.decimals)),
            ("Orientation", vector(angles, self.decimals)),
        )


Reading = OdometryReading | GroundTruthReading


def reading_from_message(message: Message) -> Reading | None:
    """Return the reading of a SEN line; None for a sensor that we do not know."""
    reader = _SENSORS.get(fields.text(message, "Type").lower())
    return reader(message) if reader else None


_SENSORS: dict[str, Callable[[Message], Reading]] = {
    "odometry": OdometryReading.from_message,
    "groundtruth": GroundTruthReading.from_message,
}


def _positive_angle(angle_rad: float) -> float:
    """Return the angle in [0, 2 pi): the remainder of a tiny negative one rounds up to 2 pi."""
    wrapped = angle_rad % _TWO_PI
    return 0.0 if wrapped >= _TWO_PI else wrapped
