"""Wheel odometry: the pose since the spawn, integrated from the rotation of the wheels."""

from __future__ import annotations

import math
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import OdometryReading
from catoptra_protocol.usarsim.reports import OdometryConfiguration
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.drive import NO_TRAVEL, integrate_arc
from catoptra_server.simulation.robot_description import DriveBase, Mount, PlanarPose
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)


@dataclass(frozen=True, slots=True)
class OdometryDescription:
    """Wheel odometry with its errors; noises are standard deviations that grow with the square
    root of the distance or turn.
    """

    name: str
    interval_s: float
    distance_scale: float = 1.0
    """Reported over rolled distance."""
    turn_scale: float = 1.0
    """Reported over rolled turn."""
    drift_rad_per_m: float = 0.0
    """Steady error of the heading, clockwise."""
    distance_noise_m: float = 0.0
    """Noise of the distance after 1 m."""
    turn_noise_rad: float = 0.0
    """Noise of the heading after a turn of 1 rad."""
    heading_noise_rad: float = 0.0
    """Noise of the heading after 1 m."""
    mount: Mount = field(default_factory=Mount)
    has_timestamp: bool = True
    """Whether UDK's readings, unlike UT2004's, carry a time."""


class OdometrySensor:
    """Pose integrated from wheel travel, with the errors of the description."""

    def __init__(
        self, description: OdometryDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._base = base
        self._random_source = random_source
        self._pose = PlanarPose(0.0, 0.0, 0.0)

    def reset(self) -> None:
        """Make the present pose the origin: SET RESET."""
        self._pose = PlanarPose(0.0, 0.0, 0.0)

    def update(self, motion: MotionStep) -> None:
        """Integrate the wheel travel of one tick."""
        travel = motion.wheel_travel
        # Skipped at rest, in most ticks: a tick has random numbers of its own, so none is lost.
        if travel == NO_TRAVEL:
            return
        # Variances proportional to distance and turn do not depend on the length of the ticks.
        of_distance, of_turn, of_heading = self._random_source.normal_variates(motion.tick, 3)
        errors, distance, turn = self._description, travel.distance_m, travel.turn_rad(self._base)
        root_distance = math.sqrt(abs(distance))
        measured_distance = errors.distance_scale * distance
        measured_distance += errors.distance_noise_m * root_distance * of_distance
        # The drift is clockwise in either direction of driving, unlike with unequal wheels.
        measured_turn = errors.turn_scale * turn + errors.drift_rad_per_m * abs(distance)
        measured_turn += errors.turn_noise_rad * math.sqrt(abs(turn)) * of_turn
        measured_turn += errors.heading_noise_rad * root_distance * of_heading
        # The same arc as the true motion: without errors odometry is exact.
        self._pose = integrate_arc(self._pose, measured_distance, measured_turn)

    def read(self, context: SensorContext) -> OdometryReading:
        """Integrated pose."""
        pose, time_s = self._pose, context.time_s if self._description.has_timestamp else None
        return OdometryReading(self._description.name, pose.x_m, pose.y_m, pose.yaw_rad, time_s)


def _read_description(item: ConfiguredSensor) -> OdometryDescription:
    drift = item.section.get_float("DriftPerMetre", 0.0, min_value=-10.0, max_value=10.0)
    return OdometryDescription(
        name=item.name,
        interval_s=item.interval_s,
        distance_scale=item.get_float("DistanceScale", 1.0, 10.0),
        turn_scale=item.get_float("TurnScale", 1.0, 10.0),
        drift_rad_per_m=drift,
        distance_noise_m=item.get_float("DistanceNoise", 0.0, 10.0),
        turn_noise_rad=item.get_float("TurnNoise", 0.0, 10.0),
        heading_noise_rad=item.get_float("HeadingNoise", 0.0, 10.0),
        mount=item.mount,
        has_timestamp=item.has_timestamp(True),
    )


ODOMETRY = SensorKind(
    "Odometry",
    OdometryDescription,
    OdometrySensor,
    {"odometrysensor": _read_description, "odometry": _read_description},
    # Travel is continuous: no resolution.
    lambda odometry: OdometryConfiguration(
        odometry.name, odometry.interval_s, encoder_resolution_rad=0.0
    ),
)
