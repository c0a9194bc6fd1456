"""The robot's true pose: for experiments, not for controllers."""

from __future__ import annotations

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.numbers import fixed
from catoptra_protocol.wire.reports import Configuration, GeometryItem, GroundTruthReading
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase, GroundTruthDescription
from catoptra_server.robot.skid_steer import Rolled


class GroundTruthSensor:
    """Report the pose as it is, with as many decimals as the description allows."""

    type = "GroundTruth"

    def __init__(
        self, description: GroundTruthDescription, base: DriveBase, stream: RandomStream
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._decimals = description.decimals

    def follow(self, way: Rolled, tick: int) -> None:
        """Ignore the wheels: the truth is where the robot is."""

    def reading(self, time_s: float, world_from_robot: Pose) -> GroundTruthReading:
        """Return the true pose."""
        x, y, z = (float(value) for value in world_from_robot.translation)
        return GroundTruthReading(
            time_s, self.name, (x, y, z), world_from_robot.rpy(), self._decimals
        )

    def configuration(self) -> Configuration:
        """Return its period."""
        pairs = (("Name", self.name), ("ScanInterval", fixed(self.interval_s, 2)))
        return Configuration(self.type, pairs)

    def geometry(self) -> GeometryItem:
        """Return the chassis: that is whose pose it tells."""
        return GeometryItem(self.name, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "HARD")
