"""Encoders: ticks of wheels and joints; all of a robot share one line."""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_protocol.wire.reports import EncoderConfiguration, EncoderReadings
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase, EncoderDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import Moment, Move, Part

_LEFT, _RIGHT = "left", "right"


class EncoderBank:
    """Count what each encoder's shaft has turned since it was reset."""

    type = "Encoder"

    def __init__(
        self, descriptions: Sequence[EncoderDescription], base: DriveBase, stream: RandomStream
    ) -> None:
        self.name = self.type
        self.interval_s = min(description.interval_s for description in descriptions)
        self._are = tuple(descriptions)
        self._wheel_radius_m = base.wheel_radius_m
        self._stream = stream
        self._rolled_rad = {_LEFT: 0.0, _RIGHT: 0.0}
        self._zero_rad = {description.name: 0.0 for description in descriptions}

    @property
    def parts(self) -> Sequence[Part]:
        """Return the encoders."""
        return tuple(
            MountedPart(self.type, e.name, e.mount, EncoderConfiguration(e.name, e.resolution_rad))
            for e in self._are
        )

    def follow(self, move: Move) -> None:
        """Turn the wheels: forward counts up."""
        self._rolled_rad[_LEFT] += move.way.left_m / self._wheel_radius_m
        self._rolled_rad[_RIGHT] += move.way.right_m / self._wheel_radius_m

    def reset(self, name: str | None, moment: Moment) -> bool:
        """Count from here on, one encoder or all: SET RESET. Return whether there is one."""
        chosen = [e for e in self._are if name is None or e.name.lower() == name.lower()]
        for encoder in chosen:
            self._zero_rad[encoder.name] = self._angle(encoder, moment)
        return bool(chosen)

    def reading(self, moment: Moment) -> EncoderReadings:
        """Return whole ticks, truncated towards zero; noise moves the angle beforehand."""
        noise = [0.0] * len(self._are)
        if any(encoder.noise_rad for encoder in self._are):
            noise = self._stream.at(moment.tick).standard_normal(len(self._are)).tolist()
        items = tuple(
            (encoder.name, self._ticks(encoder, moment, encoder.noise_rad * error))
            for encoder, error in zip(self._are, noise, strict=True)
        )
        is_timed = all(encoder.is_timed for encoder in self._are)
        return EncoderReadings(items, moment.time_s if is_timed else None)

    def _ticks(self, encoder: EncoderDescription, moment: Moment, error_rad: float) -> int:
        turned = self._angle(encoder, moment) - self._zero_rad[encoder.name] + error_rad
        return math.trunc(turned / encoder.resolution_rad)

    def _angle(self, encoder: EncoderDescription, moment: Moment) -> float:
        """Return what the shaft has turned; one that is not there never turns."""
        if encoder.shaft in self._rolled_rad:
            return self._rolled_rad[encoder.shaft]
        return moment.joints.get(encoder.shaft.lower(), 0.0)
