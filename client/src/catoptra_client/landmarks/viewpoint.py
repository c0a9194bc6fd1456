"""Where the effective viewpoint stands on the robot, and what follows for poses and sightings."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose

# Four roundings: of sine, cosine, product and sum.
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """The viewpoint's height above the floor and its offset in the robot frame (x, y).

    The mirror's axes are the robot's: the camera is upright and not turned. The paper gives no
    height; 0.6 m is assumed.
    """

    height_m: float = 0.6
    forward_m: float = 0.0
    right_m: float = 0.0

    def __post_init__(self) -> None:
        numbers = (self.height_m, self.forward_m, self.right_m)
        if not (all(map(math.isfinite, numbers)) and self.height_m > 0.0):
            raise DomainError(f"a viewpoint is finite and above the floor: {numbers}")


def world_from_mirror(viewpoint: Viewpoint, robot_pose: Floats) -> Pose:
    """Return the pose of the mirror frame for a robot at (3,) x, y, yaw on the floor z = 0."""
    robot = Pose.from_rpy((robot_pose[0], robot_pose[1], 0.0), (0.0, 0.0, robot_pose[2]))
    offset = (viewpoint.forward_m, viewpoint.right_m, -viewpoint.height_m)
    return robot @ Pose.from_rpy(offset)


def robot_from_viewpoint_polar(viewpoint: Viewpoint, polar: Floats) -> tuple[float, float, Floats]:
    """Return range, bearing seen from the robot's origin, and their derivative (2, 2).

    polar (2,): level range and azimuth seen from the viewpoint. Raises DomainError for a point at
    the robot's origin, which has no bearing.
    """
    if viewpoint.forward_m == 0.0 and viewpoint.right_m == 0.0:
        return float(polar[0]), float(polar[1]), np.eye(2)
    reach, azimuth = float(polar[0]), float(polar[1])
    x = viewpoint.forward_m + reach * math.cos(azimuth)
    y = viewpoint.right_m + reach * math.sin(azimuth)
    range_m, bearing = math.hypot(x, y), math.atan2(y, x)
    # The sum is rounded at its parts' size: what is left below that says nothing.
    if range_m <= _ROUNDING * reach:
        raise DomainError(f"{reach!r} m at {azimuth!r} rad is the robot's origin: no bearing")
    cos_d, sin_d = math.cos(azimuth - bearing), math.sin(azimuth - bearing)
    jacobian = np.array([[cos_d, -reach * sin_d], [sin_d / range_m, reach * cos_d / range_m]])
    return range_m, bearing, jacobian
