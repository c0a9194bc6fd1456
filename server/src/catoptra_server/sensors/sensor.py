"""What a sensor is: it follows the robot's moves and reports when it is its turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import (
    AnyConfiguration,
    GeometryItem,
    MissionPackageGeometry,
    Report,
)
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.skid_steer import WheelTravel
from catoptra_server.sensors.sensor_environment import EMPTY_ENVIRONMENT, SensorEnvironment


@dataclass(frozen=True, slots=True)
class MotionStep:
    """One tick of a robot: what its wheels rolled, and where it truly is afterwards.

    tick counts the robot's moves and keys random numbers.
    """

    wheel_travel: WheelTravel
    tick: int
    duration_s: float
    pose: PlanarPose


@dataclass(frozen=True, slots=True, eq=False)
class SensorContext:
    """What a reading can depend on. `joints`: radians of each link of mission packages, by name."""

    time_s: float
    tick: int
    world_from_robot: Pose
    environment: SensorEnvironment = EMPTY_ENVIRONMENT
    joint_angles_rad: Mapping[str, float] = field(default_factory=dict)


class Part(Protocol):
    """Anything on a robot that GETCONF and GETGEO can ask for."""

    @property
    def type(self) -> str:
        """Return the type that it is asked for by, as USARSim spells it."""

    @property
    def name(self) -> str:
        """Return its name, that no other part of the robot has."""

    def configuration(self) -> AnyConfiguration:
        """Return the answer to GETCONF."""

    def geometry(self) -> GeometryItem | MissionPackageGeometry:
        """Return the answer to GETGEO."""


class Sensor(Protocol):
    """What reports by itself: one part, or several that share a line, such as a ring of sonars."""

    type: str
    name: str
    interval_s: float

    @property
    def parts(self) -> Sequence[Part]:
        """Return what can be asked for."""

    def update(self, motion: MotionStep) -> None:
        """Take note of one tick."""

    def read(self, context: SensorContext) -> Report:
        """Return the report of this moment."""
