"""What a sensor is: it follows the robot's moves and reports when it is its turn."""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.reports import Configuration, GeometryItem, Report
from catoptra_server.robot.skid_steer import Rolled


class Part(Protocol):
    """Anything on a robot that GETCONF and GETGEO can ask for."""

    type: str
    name: str

    def configuration(self) -> Configuration:
        """Return the answer to GETCONF."""

    def geometry(self) -> GeometryItem:
        """Return the answer to GETGEO."""


class Sensor(Part, Protocol):
    """A part that reports by itself."""

    interval_s: float

    def follow(self, way: Rolled, tick: int) -> None:
        """Take note of what the wheels rolled in one tick."""

    def reading(self, time_s: float, world_from_robot: Pose) -> Report:
        """Return the report of this moment."""
