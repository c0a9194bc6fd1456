"""The true pose of the robot: for experiments, not for controllers."""

from __future__ import annotations

from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import GroundTruthReading
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)


@dataclass(frozen=True, slots=True)
class GroundTruthDescription:
    """A sensor of the true pose."""

    name: str
    interval_s: float
    decimals: int
    """Printed decimals of metres and radians."""
    mount: Mount = field(default_factory=Mount)
    is_chassis_pose: bool = True
    """Whether the reported pose is the robot's, not the sensor's own."""


class _GroundTruthSensor:
    """True pose with the decimals of the description."""

    def __init__(
        self, description: GroundTruthDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: the pose is the robot's."""

    def read(self, context: SensorContext) -> GroundTruthReading:
        """True pose of the chassis or the sensor."""
        pose, sensor = context.world_from_robot, self._description
        if not sensor.is_chassis_pose:
            pose = pose @ sensor.mount.parent_from_item()
        # Plain floats: reports are printed and compared, not computed with.
        x, y, z = (float(value) for value in pose.translation)
        return GroundTruthReading(
            context.time_s, sensor.name, (x, y, z), pose.to_rpy(), sensor.decimals
        )


def _read_description(item: ConfiguredSensor) -> GroundTruthDescription:
    # USARSim prints two decimals; experiments that compare poses need more.
    decimals = item.section.get_int("Decimals", 2, min_value=0, max_value=12)
    # False is the older UDK, which reports the sensor's own pose instead of the robot's.
    is_of_robot = item.section.get_bool("FixedToPlatform", True)
    return GroundTruthDescription(item.name, item.interval_s, decimals, item.mount, is_of_robot)


GROUND_TRUTH = SensorKind(
    "GroundTruth",
    GroundTruthDescription,
    _GroundTruthSensor,
    {"groundtruthsensor": _read_description, "groundtruth": _read_description},
)
