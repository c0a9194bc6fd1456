"""The robot's true pose: for experiments, not for controllers."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.usarsim.reports import GroundTruthReading, ScanIntervalConfiguration
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, GroundTruthDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext


class GroundTruthSensor:
    """Report the pose as it is, with as many decimals as the description allows."""

    type = "GroundTruth"

    def __init__(
        self, description: GroundTruthDescription, base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor."""
        told = ScanIntervalConfiguration(self.type, self.name, self.interval_s)
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Ignore the wheels: the truth is where the robot is."""

    def read(self, context: SensorContext) -> GroundTruthReading:
        """Return the true pose of the chassis, or of the sensor itself."""
        pose = context.world_from_robot
        if not self._description.is_chassis_pose:
            pose = pose @ self._description.mount.parent_from_item()
        x, y, z = (float(value) for value in pose.translation)
        return GroundTruthReading(
            context.time_s, self.name, (x, y, z), pose.to_rpy(), self._description.decimals
        )
