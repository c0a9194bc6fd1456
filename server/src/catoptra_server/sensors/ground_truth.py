"""The robot's true pose: for experiments, not for controllers."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.wire.reports import GroundTruthReading, IntervalConfiguration
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase, GroundTruthDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import Moment, Move, Part


class GroundTruthSensor:
    """Report the pose as it is, with as many decimals as the description allows."""

    type = "GroundTruth"

    def __init__(
        self, description: GroundTruthDescription, base: DriveBase, stream: RandomStream
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._is = description

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor."""
        told = IntervalConfiguration(self.type, self.name, self.interval_s)
        return (MountedPart(self.type, self.name, self._is.mount, told),)

    def follow(self, move: Move) -> None:
        """Ignore the wheels: the truth is where the robot is."""

    def reading(self, moment: Moment) -> GroundTruthReading:
        """Return the true pose of the chassis, or of the sensor itself."""
        pose = moment.world_from_robot
        if not self._is.is_of_robot:
            pose = pose @ self._is.mount.parent_from_item()
        x, y, z = (float(value) for value in pose.translation)
        return GroundTruthReading(
            moment.time_s, self.name, (x, y, z), pose.rpy(), self._is.decimals
        )
