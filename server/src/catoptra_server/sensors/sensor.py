"""Interface of a sensor: updated in every tick of the robot, read when a report is due."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Protocol

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
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
    """Motion of a robot in one tick."""

    wheel_travel: WheelTravel
    """Travel of the wheels before slip."""
    tick: int
    """Number of the tick; index of random numbers."""
    duration_s: float
    pose: PlanarPose
    """True pose after the tick."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorContext:
    """State that a reading depends on."""

    time_s: float
    tick: int
    """Number of the tick; index of random numbers, so that additional readings change no other."""
    world_from_robot: Pose
    environment: SensorEnvironment = EMPTY_ENVIRONMENT
    joint_angles_rad: Mapping[str, float] = field(default_factory=dict)
    """Angle of each joint by lower-case link name."""


class Part(Protocol):
    """Anything on a robot that replies to GETCONF and GETGEO."""

    @property
    def type(self) -> str:
        """Type by which the part is requested, as USARSim spells it."""

    @property
    def name(self) -> str:
        """Name that no other part of the robot has."""

    def configuration(self) -> AnyConfiguration:
        """Reply to GETCONF."""

    def geometry(self) -> GeometryItem | MissionPackageGeometry:
        """Reply to GETGEO."""


class Sensor(Protocol):
    """Source of one report: one part, or several that share a line, such as a ring of sonars."""

    type: str
    name: str
    interval_s: float
    """Simulation time between two reports."""

    @property
    def parts(self) -> Sequence[Part]:
        """Parts that reply to GETCONF and GETGEO."""

    def update(self, motion: MotionStep) -> None:
        """Integrate the motion of one tick."""

    def read(self, context: SensorContext) -> Report:
        """Report at one time."""
