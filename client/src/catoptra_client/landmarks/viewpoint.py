"""Effective viewpoint on the robot, and the conversion of poses and polar coordinates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose, rotation_from_rpy

# Bound of the relative error of a coordinate: roundings of sine, cosine, product and sum.
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """Position of the effective viewpoint on the robot, and how the camera is mounted there."""

    height_m: float = 0.6
    """Height above the floor, > 0. The paper gives no height; 0.6 m is assumed."""
    forward_m: float = 0.0
    """Offset along the robot's x axis."""
    right_m: float = 0.0
    """Offset along the robot's y axis."""
    rpy_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch and yaw of the mirror frame on the robot; 0 for a mirror and a hanging lens."""

    def __post_init__(self) -> None:
        numbers = (self.height_m, self.forward_m, self.right_m, *self.rpy_rad)
        if not (all(map(math.isfinite, numbers)) and self.height_m > 0.0):
            raise DomainError(f"a viewpoint is finite and above the floor: {numbers}")

    @classmethod
    def from_mount(cls, robot_from_mirror: Pose, *, floor_from_robot_m: float = 0.0) -> Viewpoint:
        """Viewpoint of a camera that is mounted on a robot.

        Args:
            robot_from_mirror: Pose of the mirror frame on the robot, as frames of the stream have.
            floor_from_robot_m: Height of the robot's origin above the floor.
        """
        x, y, z = robot_from_mirror.translation.tolist()
        return cls(floor_from_robot_m - z, x, y, robot_from_mirror.to_rpy())

    @property
    def is_turned(self) -> bool:
        """Whether the mirror frame's axes differ from the robot's."""
        return self.rpy_rad != (0.0, 0.0, 0.0)

    @property
    def rotation(self) -> Floats | None:
        """(3, 3) rotation of the mirror frame on the robot; None for none."""
        return rotation_from_rpy(*self.rpy_rad) if self.is_turned else None


def world_from_mirror(viewpoint: Viewpoint, robot_pose: Floats) -> Pose:
    """Pose of the mirror frame for a robot at (3,) x, y, yaw on the floor z = 0."""
    robot = Pose.from_rpy((robot_pose[0], robot_pose[1], 0.0), (0.0, 0.0, robot_pose[2]))
    offset = (viewpoint.forward_m, viewpoint.right_m, -viewpoint.height_m)
    return robot @ Pose.from_rpy(offset, viewpoint.rpy_rad)


def robot_from_viewpoint_polar(viewpoint: Viewpoint, polar: Floats) -> tuple[float, float, Floats]:
    """Polar coordinates around the robot's origin of a point measured from the viewpoint.

    Args:
        viewpoint: position of the viewpoint on the robot.
        polar: (2,) level range and azimuth from the viewpoint.

    Returns:
        Range, bearing, and their (2, 2) Jacobian with respect to `polar`.

    Raises:
        DomainError: the point is the robot's origin, where the bearing is undefined.
    """
    # Without an offset nothing is rounded: range and bearing pass through bit by bit.
    if viewpoint.forward_m == 0.0 and viewpoint.right_m == 0.0:
        return float(polar[0]), float(polar[1]), np.eye(2)
    reach, azimuth = float(polar[0]), float(polar[1])
    x = viewpoint.forward_m + reach * math.cos(azimuth)
    y = viewpoint.right_m + reach * math.sin(azimuth)
    range_m, bearing = math.hypot(x, y), math.atan2(y, x)
    # The sum has an absolute rounding error of the size of its terms; a smaller range is noise.
    if range_m <= _ROUNDING * reach:
        raise DomainError(f"{reach!r} m at {azimuth!r} rad is the robot's origin: no bearing")
    cos_d, sin_d = math.cos(azimuth - bearing), math.sin(azimuth - bearing)
    jacobian = np.array([[cos_d, -reach * sin_d], [sin_d / range_m, reach * cos_d / range_m]])
    return range_m, bearing, jacobian
