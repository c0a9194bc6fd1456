"""Wheel odometry: the pose since the robot was spawned, as its encoders would have it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_protocol.usarsim.reports import OdometryConfiguration, OdometryReading
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import DriveBase, OdometryDescription
from catoptra_server.robot.skid_steer import WheelTravel, integrate_arc
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext


class OdometrySensor:
    """Integrate what the wheels rolled, with the deviations that the description states."""

    type = "Odometry"

    def __init__(
        self, description: OdometryDescription, base: DriveBase, stream: RandomSource
    ) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._base = base
        self._stream = stream
        self._pose = PlanarPose(0.0, 0.0, 0.0)

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor; there is no encoder tick: the way is continuous."""
        told = OdometryConfiguration(self.name, self.interval_s, encoder_resolution_rad=0.0)
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def reset(self) -> None:
        """Start again from here: SET RESET."""
        self._pose = PlanarPose(0.0, 0.0, 0.0)

    def update(self, motion: MotionStep) -> None:
        """Move the believed pose. Noise has a variance in proportion to the way and to the turn."""
        way = motion.wheel_travel
        if way == WheelTravel(0.0, 0.0):
            return
        of_distance, of_turn, of_heading = self._stream.generator(motion.tick).standard_normal(3)
        distance, turn = way.distance_m, way.turn_rad(self._base)
        root_distance = math.sqrt(abs(distance))
        believed_distance = self._description.distance_scale * distance
        believed_distance += self._description.distance_noise_m * root_distance * float(of_distance)
        believed_turn = (
            self._description.turn_scale * turn + self._description.drift_rad_per_m * abs(distance)
        )
        believed_turn += self._description.turn_noise_rad * math.sqrt(abs(turn)) * float(of_turn)
        believed_turn += self._description.heading_noise_rad * root_distance * float(of_heading)
        self._pose = integrate_arc(self._pose, believed_distance, believed_turn)

    def read(self, context: SensorContext) -> OdometryReading:
        """Return the believed pose."""
        pose, time_s = self._pose, context.time_s if self._description.has_timestamp else None
        return OdometryReading(self.name, pose.x_m, pose.y_m, pose.yaw_rad, time_s)
