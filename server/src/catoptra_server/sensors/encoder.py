"""Encoders: ticks of wheels and joints; all of a robot share one line."""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_protocol.usarsim.reports import EncoderConfiguration, EncoderReadings
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, EncoderDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext

_LEFT, _RIGHT = "left", "right"


class EncoderBank:
    """Count what each encoder's shaft has turned since it was reset."""

    type = "Encoder"

    def __init__(
        self, descriptions: Sequence[EncoderDescription], base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = self.type
        self.interval_s = min(description.interval_s for description in descriptions)
        self._descriptions = tuple(descriptions)
        self._wheel_radius_m = base.wheel_radius_m
        self._stream = stream
        self._wheel_angles_rad = {_LEFT: 0.0, _RIGHT: 0.0}
        self._zero_angles_rad = {description.name: 0.0 for description in descriptions}

    @property
    def parts(self) -> Sequence[Part]:
        """Return the encoders."""
        return tuple(
            MountedPart(self.type, e.name, e.mount, EncoderConfiguration(e.name, e.resolution_rad))
            for e in self._descriptions
        )

    def update(self, motion: MotionStep) -> None:
        """Turn the wheels: forward counts up."""
        self._wheel_angles_rad[_LEFT] += motion.wheel_travel.left_m / self._wheel_radius_m
        self._wheel_angles_rad[_RIGHT] += motion.wheel_travel.right_m / self._wheel_radius_m

    def reset(self, name: str | None, context: SensorContext) -> bool:
        """Count from here on, one encoder or all: SET RESET. Return whether there is one."""
        chosen = [e for e in self._descriptions if name is None or e.name.lower() == name.lower()]
        for encoder in chosen:
            self._zero_angles_rad[encoder.name] = self._shaft_angle_rad(encoder, context)
        return bool(chosen)

    def read(self, context: SensorContext) -> EncoderReadings:
        """Return whole ticks, truncated towards zero; noise moves the angle beforehand."""
        noise = [0.0] * len(self._descriptions)
        if any(encoder.noise_rad for encoder in self._descriptions):
            noise = (
                self._stream.generator(context.tick)
                .standard_normal(len(self._descriptions))
                .tolist()
            )
        items = tuple(
            (encoder.name, self._ticks(encoder, context, encoder.noise_rad * error))
            for encoder, error in zip(self._descriptions, noise, strict=True)
        )
        is_timed = all(encoder.has_timestamp for encoder in self._descriptions)
        return EncoderReadings(items, context.time_s if is_timed else None)

    def _ticks(self, encoder: EncoderDescription, context: SensorContext, error_rad: float) -> int:
        turned = (
            self._shaft_angle_rad(encoder, context)
            - self._zero_angles_rad[encoder.name]
            + error_rad
        )
        return math.trunc(turned / encoder.resolution_rad)

    def _shaft_angle_rad(self, encoder: EncoderDescription, context: SensorContext) -> float:
        """Return what the shaft has turned; one that is not there never turns."""
        if encoder.shaft in self._wheel_angles_rad:
            return self._wheel_angles_rad[encoder.shaft]
        return context.joint_angles_rad.get(encoder.shaft.lower(), 0.0)
