"""Inertial navigation: the pose in the world, with errors that grow while time passes.

Noise makes random walks of position and heading, the simplest model of integrated white noise.
Their variance grows with time, however it is cut into ticks. UDK's Precision is a steady error of
each metre and of each radian, drawn once for a robot. Source: INS.uc, whose noise too grows with
the way alone; ours also while the robot stands, as a real one's does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import InsReading, ScanIntervalConfiguration
from catoptra_protocol.vectors import Vector3
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import DriveBase, InsDescription
from catoptra_server.sensors.mounted_part import MountedPart
from catoptra_server.sensors.sensor import MotionStep, Part, SensorContext


class InsSensor:
    """Add its errors to the true pose of where it is mounted."""

    type = "INS"

    def __init__(self, description: InsDescription, base: DriveBase, stream: RandomSource) -> None:
        self.name = description.name
        self.interval_s = description.interval_s
        self._description = description
        self._stream = stream
        self._robot_from_ins = description.mount.parent_from_item()
        self._error = (0.0, 0.0, 0.0)  # x, y in metres, yaw in radians
        self._bias = _sample_bias(description, stream)  # m/m, m/m, rad/rad
        self._previous_pose: PlanarPose | None = None

    @property
    def parts(self) -> Sequence[Part]:
        """Return the sensor."""
        told = ScanIntervalConfiguration(self.type, self.name, self.interval_s)
        return (MountedPart(self.type, self.name, self._description.mount, told),)

    def update(self, motion: MotionStep) -> None:
        """Let the errors walk on, if they drift."""
        if not self._description.is_drifting:
            return
        if any(self._bias):
            self._add_bias(motion.pose)
        if self._description.noise:
            scale = self._description.noise * math.sqrt(motion.duration_s)
            x, y, yaw = (
                scale * float(n) for n in self._stream.generator(motion.tick).standard_normal(3)
            )
            self._add_error(x, y, yaw)

    def _add_bias(self, pose: PlanarPose) -> None:
        """Add the steady error of the way since the last tick; the first tick only remembers."""
        before, self._previous_pose = self._previous_pose or pose, pose
        way_m = math.hypot(pose.x_m - before.x_m, pose.y_m - before.y_m)
        turn_rad = wrap_angle(pose.yaw_rad - before.yaw_rad)
        self._add_error(self._bias[0] * way_m, self._bias[1] * way_m, self._bias[2] * turn_rad)

    def _add_error(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        x, y, yaw = self._error
        self._error = (x + x_m, y + y_m, yaw + yaw_rad)

    def set_pose(self, location_m: Vector3, rotation_rad: Vector3, world_from_robot: Pose) -> None:
        """Take a pose of the sensor for true: SET POSE. Only the level errors follow from it."""
        pose = world_from_robot @ self._robot_from_ins
        x, y = float(pose.translation[0]), float(pose.translation[1])
        yaw = wrap_angle(rotation_rad[2] - pose.to_rpy()[2])
        self._error = (location_m[0] - x, location_m[1] - y, yaw)

    def read(self, context: SensorContext) -> InsReading:
        """Return the believed pose."""
        pose = context.world_from_robot @ self._robot_from_ins
        x, y, z = (float(value) for value in pose.translation)
        roll, pitch, yaw = pose.to_rpy()
        off_x, off_y, off_yaw = (
            self._error if self._description.is_drifting else self._reading_error(context)
        )
        location, rotation = (x + off_x, y + off_y, z), (roll, pitch, wrap_angle(yaw + off_yaw))
        return InsReading(
            self.name,
            location,
            rotation,
            context.time_s if self._description.has_timestamp else None,
        )

    def _reading_error(self, context: SensorContext) -> Vector3:
        """Return the error of one reading: noise, on top of what SET POSE left."""
        if not self._description.noise:
            return self._error
        noise = self._stream.generator(context.tick).standard_normal(3)
        x, y, yaw = (
            e + self._description.noise * float(n) for e, n in zip(self._error, noise, strict=True)
        )
        return x, y, yaw


# No robot lives so many ticks: its bias shares no number with its noise.
_BIAS_STREAM_INDEX = 2**63


def _sample_bias(description: InsDescription, stream: RandomSource) -> Vector3:
    """Return the steady errors of x and y in a metre and of yaw in a radian."""
    if not description.precision:
        return 0.0, 0.0, 0.0
    x, y, yaw = stream.generator(_BIAS_STREAM_INDEX).uniform(-0.5, 0.5, 3) / description.precision
    return float(x), float(y), float(yaw) / description.precision
