"""A victim sensor: victims in the field of view, in range, and not occluded."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.elementary import arctan2, hypot, matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import VictimPart, VictimReading
from catoptra_protocol.usarsim.reports import Configuration
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorEnvironment,
    SensorKind,
)
from catoptra_server.world.world_description import Victim

# Victims may be meshes of the scene: a surface this near to a victim's position is the victim.
_VICTIM_RADIUS_M = 0.4


@dataclass(frozen=True, slots=True)
class VictimSensorDescription:
    """A victim sensor, looking along the x axis of the mount."""

    name: str
    interval_s: float
    mount: Mount
    fov_rad: float
    """Horizontal field of view."""
    max_range_m: float


class _VictimSensor:
    """Positions of the world file's victims in view."""

    def __init__(
        self, description: VictimSensorDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._robot_from_sensor = description.mount.parent_from_item()

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: victims are found at one time."""

    def read(self, context: SensorContext) -> VictimReading:
        """Victims in view, each with its position in the sensor's frame."""
        world_from_sensor = context.world_from_robot @ self._robot_from_sensor
        parts = tuple(
            VictimPart(victim.name, position_m)
            for victim in context.environment.victims
            if (position_m := self._locate(victim, world_from_sensor, context.environment))
            is not None
        )
        status = "" if parts else "NoVictims"
        return VictimReading(context.time_s, self._description.name, status, parts)

    def _locate(
        self, victim: Victim, world_from_sensor: Pose, environment: SensorEnvironment
    ) -> tuple[float, float, float] | None:
        """Position of a victim in the sensor's frame; None outside the view."""
        displacement: Floats = np.asarray(victim.position_m) - world_from_sensor.translation
        distance = hypot(*displacement)
        # A victim at the sensor itself has no direction.
        if not 0.0 < distance <= self._description.max_range_m:
            return None
        # Rows times rotation: the transpose turns world axes into the sensor frame.
        x, y, z = (float(value) for value in matmul(displacement, world_from_sensor.rotation))
        # The field of view is a wedge: heights are not limited.
        if abs(arctan2(y, x)) > 0.5 * self._description.fov_rad:
            return None
        direction = (displacement / distance)[None]
        free_m = environment.distances(world_from_sensor.translation, direction)[0]
        return (x, y, z) if free_m >= distance - _VICTIM_RADIUS_M else None


def _read_description(item: ConfiguredSensor) -> VictimSensorDescription:
    return VictimSensorDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        fov_rad=item.get_float("FOV", 0.6981, 6.2832),
        max_range_m=item.get_float("MaxRange", 6.0),
    )


def _configure(sensor: VictimSensorDescription) -> Configuration:
    limits = (
        ("MaxRange", format_fixed_point(sensor.max_range_m)),
        ("Fov", format_fixed_point(sensor.fov_rad)),
    )
    return Configuration("VictSensor", (("Name", sensor.name), *limits))


VICTIM_SENSOR = SensorKind(
    "VictSensor",
    VictimSensorDescription,
    _VictimSensor,
    {"victsensor": _read_description, "victimsensor": _read_description},
    _configure,
    casts_rays=True,
)
