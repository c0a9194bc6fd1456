"""An RFID reader: the numbers of all tags within its range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_protocol.usarsim.reports import Configuration, RfidReading
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.robot_description import DriveBase, RfidDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext


class RfidSensor:
    """List tags in reach, in the order of the world file. Radio passes through walls."""

    type = "RFID"

    def __init__(self, description: RfidDescription, base: DriveBase, stream: RandomSource) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._robot_from_reader = description.mount.parent_from_item()

    @property
    def parts(self) -> Sequence[Part]:
        """Return the reader."""
        pairs = (
            ("Name", self.name),
            ("MaxRange", format_fixed_point(self._description.max_range_m)),
        )
        told = Configuration(self.type, pairs)
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Ignore the way."""

    def read(self, context: SensorContext) -> RfidReading:
        """Return the tags in reach."""
        reader = context.world_from_robot.transform_points(self._robot_from_reader.translation)
        ids = tuple(
            tag.number
            for tag in context.environment.rfid_tags
            if np.linalg.norm(reader - tag.position_m) <= self._description.max_range_m
        )
        return RfidReading(context.time_s, self.name, ids)
