"""Inertial navigation: the pose in the world, with errors that grow with time.

Noise makes random walks of position and heading, the simplest model of integrated white noise,
whose variance grows with time however time is cut into ticks; they take a step after a tenth of a
second, as random numbers of each tick would be most of what a robot costs that stands. UDK's
Precision is a steady error per metre over ground and per radian, sampled once for a robot. Source:
INS.uc, where noise grows with distance only; here also while the robot stands, as in a real
instrument. Roll and pitch have none: gravity corrects them. Nor has height.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import InsReading
from catoptra_protocol.vectors import Vector3
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount, PlanarPose
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)


@dataclass(frozen=True, slots=True)
class InsDescription:
    """An inertial navigation system."""

    name: str
    interval_s: float
    mount: Mount
    noise: float = 0.0
    """Standard deviation in metres and radians: of the random walks after 1 s if drifting, else of
    each reading."""
    is_drifting: bool = True
    precision: float = 0.0
    """If drifting, each metre adds up to 1 / (2 precision) metres to x and y, and each radian up to
    1 / (2 precision^2) radians to yaw, constant for the life of a robot; 0 for no such error."""
    has_timestamp: bool = False
    """Whether UDK's readings, unlike UT2004's, carry a time."""


class InsSensor:
    """True pose of the sensor plus errors of position and heading."""

    def __init__(
        self, description: InsDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._random_source = random_source
        self._robot_from_ins = description.mount.parent_from_item()
        self._error = (0.0, 0.0, 0.0)  # x, y in metres, yaw in radians
        # Set by SET POSE alone; neither noise nor drift adds to them.
        self._height_error_m = 0.0
        self._tilt_error_rad = (0.0, 0.0)  # roll, pitch
        self._bias = _sample_bias(description, random_source)  # m/m, m/m, rad/rad
        self._previous_pose: PlanarPose | None = None
        self._unwalked_s = 0.0

    def update(self, motion: MotionStep) -> None:
        """Advance the errors of a drifting sensor by one tick."""
        if not self._description.is_drifting:
            return
        if any(self._bias):
            self._add_bias(motion.pose)
        self._unwalked_s += motion.duration_s
        if self._description.noise and self._unwalked_s > _WALK_INTERVAL_S:
            # A random walk: the standard deviation of a step grows with the root of its time.
            scale = self._description.noise * math.sqrt(self._unwalked_s)
            self._unwalked_s = 0.0
            noise = self._random_source.normal_variates(motion.tick, 3)
            x, y, yaw = (scale * variate for variate in noise)
            self._add_error(x, y, yaw)

    def _add_bias(self, pose: PlanarPose) -> None:
        """Add the steady error of the motion since the last tick; none in the first tick."""
        # The spawn pose is unknown here: the first tick only sets the reference.
        before, self._previous_pose = self._previous_pose or pose, pose
        distance_m = hypot(pose.x_m - before.x_m, pose.y_m - before.y_m)
        turn_rad = wrap_angle(pose.yaw_rad - before.yaw_rad)
        bias_x, bias_y, bias_yaw = self._bias
        self._add_error(bias_x * distance_m, bias_y * distance_m, bias_yaw * turn_rad)

    def _add_error(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        x, y, yaw = self._error
        self._error = (x + x_m, y + y_m, yaw + yaw_rad)

    def set_pose(self, location_m: Vector3, rotation_rad: Vector3, world_from_robot: Pose) -> None:
        """Set the pose that the sensor reports: SET POSE.

        Args:
            location_m: Reported location.
            rotation_rad: Reported roll, pitch, yaw.
            world_from_robot: True pose of the robot.
        """
        pose = world_from_robot @ self._robot_from_ins
        x, y, z = (float(value) for value in pose.translation)
        roll, pitch, yaw = pose.to_rpy()
        # Errors, not a pose, are stored: the estimate moves with the robot afterwards.
        self._error = (location_m[0] - x, location_m[1] - y, wrap_angle(rotation_rad[2] - yaw))
        self._height_error_m = location_m[2] - z
        self._tilt_error_rad = (
            wrap_angle(rotation_rad[0] - roll),
            wrap_angle(rotation_rad[1] - pitch),
        )

    def read(self, context: SensorContext) -> InsReading:
        """Estimated pose."""
        pose = context.world_from_robot @ self._robot_from_ins
        x, y, z = (float(value) for value in pose.translation)
        roll, pitch, yaw = pose.to_rpy()
        is_drifting = self._description.is_drifting
        error_x, error_y, error_yaw = self._error if is_drifting else self._reading_error(context)
        error_roll, error_pitch = self._tilt_error_rad
        # Errors along world axes; of z, roll and pitch they are constant between two SET POSE.
        return InsReading(
            self._description.name,
            (x + error_x, y + error_y, z + self._height_error_m),
            (
                wrap_angle(roll + error_roll),
                wrap_angle(pitch + error_pitch),
                wrap_angle(yaw + error_yaw),
            ),
            context.time_s if self._description.has_timestamp else None,
        )

    def _reading_error(self, context: SensorContext) -> Vector3:
        """Error of one reading of a sensor that does not drift: noise, on top of SET POSE."""
        sigma = self._description.noise
        if not sigma:
            return self._error
        noise = self._random_source.normal_variates(context.tick, 3)
        x, y, yaw = (e + sigma * n for e, n in zip(self._error, noise, strict=True))
        return x, y, yaw


# Rounding of sums of ticks takes no step later.
_WALK_INTERVAL_S = 0.1 - 1e-9
# Beyond any tick that a robot reaches: bias and noise share no random number.
_BIAS_STREAM_INDEX = 2**63


def _sample_bias(description: InsDescription, random_source: RandomSource) -> Vector3:
    """Steady errors of x and y per metre and of yaw per radian. Source: INS.uc."""
    if not description.precision:
        return 0.0, 0.0, 0.0
    samples = random_source.generator(_BIAS_STREAM_INDEX).uniform(-0.5, 0.5, 3)
    x, y, yaw = samples / description.precision
    return float(x), float(y), float(yaw) / description.precision


def _read_description(item: ConfiguredSensor) -> InsDescription:
    return InsDescription(
        name=item.name,
        interval_s=item.interval_s,
        mount=item.mount,
        noise=item.get_float("Noise", 0.0, 10.0),
        is_drifting=item.section.get_bool("Drifting", True),
        precision=item.get_float("Precision", 0.0, 1e9),
        has_timestamp=item.has_timestamp(False),
    )


INS = SensorKind(
    "INS", InsDescription, InsSensor, {"inssensor": _read_description, "ins": _read_description}
)
