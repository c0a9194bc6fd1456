"""A victim sensor: which victims are in its field of view, in range, and not behind a wall."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import Configuration, VictimPart, VictimReading
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, VictimSensorDescription
from catoptra_server.scene.world_description import Victim
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext
from catoptra_server.sensors.sensor_environment import SensorEnvironment

# A victim may be drawn in the scene: what is met this near to its place is the victim itself.
_VICTIM_RADIUS_M = 0.4


class VictimSensor:
    """Look along the mount's x for victims of the world file."""

    type = "VictSensor"

    def __init__(
        self, description: VictimSensorDescription, base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._robot_from_sensor = description.mount.parent_from_item()

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor."""
        limits = (
            ("MaxRange", format_fixed_point(self._description.max_range_m)),
            ("Fov", format_fixed_point(self._description.fov_rad)),
        )
        told = Configuration(self.type, (("Name", self.name), *limits))
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Ignore the way."""

    def read(self, context: SensorContext) -> VictimReading:
        """Return each victim in sight, with its place in the sensor's frame."""
        world_from_sensor = context.world_from_robot @ self._robot_from_sensor
        parts = tuple(
            VictimPart(victim.name, place)
            for victim in context.environment.victims
            if (place := self._locate(victim, world_from_sensor, context.environment)) is not None
        )
        status = "" if parts else "NoVictims"
        return VictimReading(context.time_s, self.name, status, parts)

    def _locate(
        self, victim: Victim, world_from_sensor: Pose, environment: SensorEnvironment
    ) -> tuple[float, float, float] | None:
        way: Floats = np.asarray(victim.position_m) - world_from_sensor.translation
        distance = float(np.linalg.norm(way))
        if not 0.0 < distance <= self._description.max_range_m:
            return None
        x, y, z = (float(value) for value in way @ world_from_sensor.rotation)
        if abs(math.atan2(y, x)) > 0.5 * self._description.fov_rad:
            return None
        met = environment.distances(world_from_sensor.translation, (way / distance)[None])
        return (x, y, z) if met[0] >= distance - _VICTIM_RADIUS_M else None
