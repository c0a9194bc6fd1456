"""The true pose of the robot: for experiments, not for controllers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import GroundTruthReading
from catoptra_protocol.usarsim.reports import ScanIntervalConfiguration
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors.sensor import (
    ConfiguredSensor,
    MotionStep,
    MountedPart,
    Part,
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


class GroundTruthSensor:
    """True pose with the decimals of the description."""

    type = "GroundTruth"

    def __init__(
        self, description: GroundTruthDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description

    @property
    def parts(self) -> Sequence[Part]:
        """The sensor."""
        configuration = ScanIntervalConfiguration(self.type, self.name, self.interval_s)
        return (MountedPart(self.type, self.name, self._description.mount, configuration),)

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: the pose is the robot's."""

    def read(self, context: SensorContext) -> GroundTruthReading:
        """True pose of the chassis or the sensor."""
        pose = context.world_from_robot
        if not self._description.is_chassis_pose:
            pose = pose @ self._description.mount.parent_from_item()
        # Plain floats: reports are printed and compared, not computed with.
        x, y, z = (float(value) for value in pose.translation)
        return GroundTruthReading(
            context.time_s, self.name, (x, y, z), pose.to_rpy(), self._description.decimals
        )


def _read_description(item: ConfiguredSensor) -> GroundTruthDescription:
    # USARSim prints two decimals; experiments that compare poses need more.
    decimals = item.section.get_int("Decimals", 2, min_value=0, max_value=12)
    # False is the older UDK, which reports the sensor's own pose instead of the robot's.
    is_of_robot = item.section.get_bool("FixedToPlatform", True)
    return GroundTruthDescription(item.name, item.interval_s, decimals, item.mount, is_of_robot)


GROUND_TRUTH = SensorKind(
    GroundTruthDescription,
    GroundTruthSensor,
    {"groundtruthsensor": _read_description, "groundtruth": _read_description},
)
