"""Encoders: ticks of wheels and joints; all encoders of a robot report in one line."""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import EncoderReadings
from catoptra_protocol.usarsim.reports import EncoderConfiguration
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)

_LEFT, _RIGHT = "left", "right"


@dataclass(frozen=True, slots=True)
class EncoderDescription:
    """An encoder of one shaft."""

    name: str
    interval_s: float
    mount: Mount
    shaft: str
    """left or right for the wheels of a side, otherwise the name of a link."""
    resolution_rad: float
    """Angle of one tick."""
    noise_rad: float = 0.0
    """Standard deviation of the angle before ticks are counted."""
    has_timestamp: bool = True
    """Whether UDK's readings, unlike UT2004's, carry a time."""


class EncoderBank:
    """Rotation of each encoder's shaft since the last reset."""

    def __init__(
        self,
        descriptions: Sequence[EncoderDescription],
        base: DriveBase,
        random_source: RandomSource,
    ) -> None:
        self._descriptions = tuple(descriptions)
        self._wheel_radius_m = base.wheel_radius_m
        self._random_source = random_source
        self._wheel_angles_rad = {_LEFT: 0.0, _RIGHT: 0.0}
        self._zero_angles_rad = {description.name: 0.0 for description in descriptions}

    def update(self, motion: MotionStep) -> None:
        """Integrate the wheel travel of one tick; forward counts up."""
        # Joints are not integrated: their angles are part of each reading's context.
        self._wheel_angles_rad[_LEFT] += motion.wheel_travel.left_m / self._wheel_radius_m
        self._wheel_angles_rad[_RIGHT] += motion.wheel_travel.right_m / self._wheel_radius_m

    def reset(self, name: str | None, context: SensorContext) -> bool:
        """Set the count to 0: SET RESET.

        Args:
            name: Name of an encoder in any case; None for all encoders.

        Returns:
            Whether such an encoder exists.
        """
        chosen = [e for e in self._descriptions if name is None or e.name.lower() == name.lower()]
        for encoder in chosen:
            self._zero_angles_rad[encoder.name] = self._shaft_angle_rad(encoder, context)
        return bool(chosen)

    def read(self, context: SensorContext) -> EncoderReadings:
        """Whole ticks, truncated towards 0."""
        count = len(self._descriptions)
        noise = [0.0] * count
        if any(encoder.noise_rad for encoder in self._descriptions):
            noise = self._random_source.normal_variates(context.tick, count)
        items = tuple(
            (encoder.name, self._ticks(encoder, context, encoder.noise_rad * error))
            for encoder, error in zip(self._descriptions, noise, strict=True)
        )
        # One time for the line: present only if every encoder's class has one.
        has_timestamp = all(encoder.has_timestamp for encoder in self._descriptions)
        return EncoderReadings(items, context.time_s if has_timestamp else None)

    def _ticks(self, encoder: EncoderDescription, context: SensorContext, error_rad: float) -> int:
        zero_rad = self._zero_angles_rad[encoder.name]
        angle_rad = self._shaft_angle_rad(encoder, context) - zero_rad + error_rad
        return math.trunc(angle_rad / encoder.resolution_rad)

    def _shaft_angle_rad(self, encoder: EncoderDescription, context: SensorContext) -> float:
        """Angle of a shaft; 0 for a shaft that the robot does not have."""
        if encoder.shaft in self._wheel_angles_rad:
            return self._wheel_angles_rad[encoder.shaft]
        return context.joint_angles_rad.get(encoder.shaft.lower(), 0.0)


# The shaft of an encoder is in its Parent, or else in its name: ECLeft, ECPan; or W and a wheel's
# number, as in UDK: 0 front right, 1 front left, 2 back right, 3 back left. Source: P3AT.uc.
_SHAFTS = {
    "left": _LEFT,
    "right": _RIGHT,
    "tilt": "CameraTilt",
    "pan": "CameraPan",
    "w0": _RIGHT,
    "w1": _LEFT,
    "w2": _RIGHT,
    "w3": _LEFT,
}


def _read_description(item: ConfiguredSensor) -> EncoderDescription:
    shaft_name = item.struct.get_str("Parent", "").lower() or item.name.lower()
    shafts = [shaft for word, shaft in _SHAFTS.items() if word in shaft_name]
    return EncoderDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        # Any other name is a joint's of the chassis, such as a flipper.
        shaft=shafts[0] if shafts else shaft_name,
        resolution_rad=item.section.get_float("Resolution", 0.01745, min_value=1e-6, max_value=6.3),
        noise_rad=item.get_float("Noise", 0.0, 10.0),
        has_timestamp=item.has_timestamp(True),
    )


ENCODER = SensorKind(
    "Encoder",
    EncoderDescription,
    EncoderBank,
    {"encodersensor": _read_description, "encoder": _read_description},
    lambda encoder: EncoderConfiguration(encoder.name, encoder.resolution_rad),
    shared_stream="all encoders",
)
