"""A victim sensor: which victims are in its field of view, in range, and not behind a wall."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.wire.numbers import fixed
from catoptra_protocol.wire.reports import Configuration, VictimPart, VictimReading
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase, VictimSensorDescription
from catoptra_server.scene.description import Victim
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import Moment, Move, Part
from catoptra_server.sensors.sight import Surroundings

# A victim may be drawn in the scene: what is met this near to its place is the victim itself.
_BODY_M = 0.4


class VictimSensor:
    """Look along the mount's x for victims of the world file."""

    type = "VictSensor"

    def __init__(
        self, description: VictimSensorDescription, base: DriveBase, stream: RandomStream
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._is = description
        self._robot_from_sensor = description.mount.parent_from_item()

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor."""
        limits = (("MaxRange", fixed(self._is.max_range_m)), ("Fov", fixed(self._is.fov_rad)))
        told = Configuration(self.type, (("Name", self.name), *limits))
        return (MountedPart(self.type, self.name, self._is.mount, told),)

    def follow(self, move: Move) -> None:
        """Ignore the way."""

    def reading(self, moment: Moment) -> VictimReading:
        """Return each victim in sight, with its place in the sensor's frame."""
        world_from_sensor = moment.world_from_robot @ self._robot_from_sensor
        parts = tuple(
            VictimPart(victim.name, place)
            for victim in moment.around.victims
            if (place := self._seen(victim, world_from_sensor, moment.around)) is not None
        )
        status = "" if parts else "NoVictims"
        return VictimReading(moment.time_s, self.name, status, parts)

    def _seen(
        self, victim: Victim, world_from_sensor: Pose, around: Surroundings
    ) -> tuple[float, float, float] | None:
        way: Floats = np.asarray(victim.position_m) - world_from_sensor.translation
        distance = float(np.linalg.norm(way))
        if not 0.0 < distance <= self._is.max_range_m:
            return None
        x, y, z = (float(value) for value in way @ world_from_sensor.rotation)
        if abs(math.atan2(y, x)) > 0.5 * self._is.fov_rad:
            return None
        met = around.distances(world_from_sensor.translation, (way / distance)[None])
        return (x, y, z) if met[0] >= distance - _BODY_M else None
