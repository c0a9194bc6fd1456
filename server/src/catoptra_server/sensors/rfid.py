"""An RFID reader: the numbers of all tags within its range."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_protocol.wire.numbers import fixed
from catoptra_protocol.wire.reports import Configuration, RfidReading
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase, RfidDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import Moment, Move, Part


class RfidSensor:
    """List tags in reach, in the order of the world file. Radio passes through walls."""

    type = "RFID"

    def __init__(self, description: RfidDescription, base: DriveBase, stream: RandomStream) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._is = description
        self._robot_from_reader = description.mount.parent_from_item()

    @property
    def parts(self) -> Sequence[Part]:
        """Return the reader."""
        pairs = (("Name", self.name), ("MaxRange", fixed(self._is.max_range_m)))
        told = Configuration(self.type, pairs)
        return (MountedPart(self.type, self.name, self._is.mount, told),)

    def follow(self, move: Move) -> None:
        """Ignore the way."""

    def reading(self, moment: Moment) -> RfidReading:
        """Return the tags in reach."""
        reader = moment.world_from_robot.points(self._robot_from_reader.translation)
        ids = tuple(
            tag.number
            for tag in moment.around.tags
            if np.linalg.norm(reader - tag.position_m) <= self._is.max_range_m
        )
        return RfidReading(moment.time_s, self.name, ids)
