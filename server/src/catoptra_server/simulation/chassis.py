"""Shape of a base: the sides on which it can lie, and the boxes that things stop."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from catoptra_protocol.optics.elementary import arccos, arctan2, cos, hypot, matmul, sin, tan
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.resting import LIFT_M, Side, Stance, robot_pose
from catoptra_server.simulation.robot_description import DriveBase

GRAVITY_M_S2 = 9.81
SKIN_M = 0.005
"""The box of a body ends as far above the belly, whose points lie some centimetres apart."""
_RIM_STEP_RAD = math.radians(7.5)
# Cosine to the vertical of a side to tip over to.
_MIN_FACING = 0.05


class Hull(NamedTuple):
    """A box of the chassis frame."""

    centre: Floats
    half_m: Floats


class ChassisShape(NamedTuple):
    """Shape of a base, as it stands and as it collides."""

    sides: tuple[Side, ...]
    hulls: tuple[Hull, Hull]
    """Of the body, and of what else things stop: wheels where walls are beside them, or, of what
    lies on another side, all down to the plane of the wheels."""
    whole: Hull
    is_lying: bool
    reach_m: float
    """Distance of the farthest corner from the origin of the chassis."""
    steepest: float
    """Tangent of the largest tilt at which it lies still."""
    steepest_climb: float
    """Tangent of the steepest plane that it climbs."""
    tumble_rad_s: float
    """Speed at which it turns on after it slid off an edge."""

    @property
    def as_lying(self) -> ChassisShape:
        """The shape of a base that lies on another side than its wheels."""
        return self._replace(hulls=(self.hulls[0], self.whole), is_lying=True)

    def widen(self, clearance_m: float) -> ChassisShape:
        """The shape with a distance on its four sides."""
        wider = np.array((clearance_m, clearance_m, 0.0))
        body, rest = (one._replace(half_m=one.half_m + wider) for one in self.hulls)
        return self._replace(
            hulls=(body, rest), whole=self.whole._replace(half_m=self.whole.half_m + wider)
        )

    def tip(self, stance: Stance) -> Stance | None:
        """The same pose as a stance on the side that faces the ground next; None if none does."""
        where = robot_pose(stance, self.sides[stance.side])
        facing = self._face_ground(where)
        facing[stance.side] = -1.0
        side = max(range(len(facing)), key=facing.__getitem__)
        return self._stand_on(where, side) if facing[side] > _MIN_FACING else None

    def tumble(self, stance: Stance, axis: tuple[float, float], duration_s: float) -> Stance:
        """Stance after it turned for a time about a level axis through the robot's origin."""
        where = robot_pose(stance, self.sides[stance.side])
        turn = _rotate_about(*axis, self.tumble_rad_s * duration_s)
        turned = Pose(matmul(turn, where.rotation), where.translation)
        facing = self._face_ground(turned)
        return self._stand_on(turned, max(range(len(facing)), key=facing.__getitem__))

    def _face_ground(self, where: Pose) -> list[float]:
        """Cosine of the angle between the normal of each side and straight down."""
        normals = np.array([one.robot_from_side.rotation[:, 2] for one in self.sides])
        facing: list[float] = matmul(normals, where.rotation[2]).tolist()
        return facing

    def _stand_on(self, where: Pose, side: int) -> Stance:
        """A pose as a stance on a side that faces the ground."""
        pose = where @ self.sides[side].robot_from_side
        (fx, fy, _), (nx, ny, nz) = pose.rotation[:, 0].tolist(), pose.rotation[:, 2].tolist()
        x, y, z = pose.translation.tolist()
        return Stance(x, y, arctan2(fy, fx), z, -nx / nz, -ny / nz, side)


@cache
def shape_chassis(base: DriveBase, height_m: float) -> ChassisShape:
    """Shape of the chassis of a base that meets things up to a height above its wheels' plane."""
    length, width, body_height = base.collision_size_m
    height = max(height_m, body_height, base.max_step_m + 0.05)
    ride, belly = base.ride_height_m, base.max_step_m
    low, high = ride - belly - SKIN_M, ride - height  # z of the box, which points down
    body = _hull(0.5 * length, 0.5 * width, low, high)
    whole = _hull(0.5 * length, 0.5 * width, ride, high)
    wheels = np.abs(np.reshape(base.wheel_places_m, (-1, 2)))
    reach_x, reach_y = wheels.max(axis=0, initial=0.0).tolist()
    reach_x += math.sqrt(max(belly * (2.0 * base.wheel_radius_m - belly), 0.0))
    identity = np.eye(3)
    pose = Pose(identity, np.array((0.0, 0.0, ride)))
    sides = [
        Side(pose, pose.inverse(), *_underside(base), base.wheel_places_m, base.wheel_radius_m)
    ]
    # Columns: x, y and z of a side in the chassis; the roof first.
    for axes in (
        ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
        ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
        ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
        ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
        ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    ):
        rotation = np.array(axes, dtype=float).T
        reach = np.abs(matmul(whole.half_m, rotation))
        middle = whole.centre + rotation[:, 2] * (reach[2] + 0.4 * SKIN_M)
        grid = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, 3)] * 2, [0.0]), axis=-1)
        points = grid.reshape(-1, 3) * reach
        lifts, pose = np.full(len(points), LIFT_M), Pose(rotation, middle)
        sides.append(Side(pose, pose.inverse(), points, lifts, (reach[0], reach[1]), 0.0))
    corner = hypot(0.5 * length, 0.5 * width, max(ride, abs(high)))
    # A rod that has turned about its middle from level to the largest tilt: v^2 = 2 g h.
    lost_m = 0.5 * length * (1.0 - cos(base.max_tilt_rad))
    return ChassisShape(
        tuple(sides),
        (body, _hull(reach_x, reach_y, ride, low)),
        whole,
        False,
        float(corner),
        tan(base.max_tilt_rad),
        tan(base.max_climb_rad),
        math.sqrt(1.5 * GRAVITY_M_S2 * lost_m) / (0.5 * length),
    )


def _hull(x: float, y: float, low: float, high: float) -> Hull:
    """Box of half sides x and y between two z, which point down."""
    return Hull(np.array((0.0, 0.0, 0.5 * (low + high))), np.array((x, y, 0.5 * (low - high))))


def _underside(base: DriveBase) -> tuple[Floats, Floats, tuple[float, float], float]:
    """Points, lifts, half sides and rise of the side of the wheels: rims, and the belly."""
    radius, step = base.wheel_radius_m, base.max_step_m
    # What is higher on a rim than a step is touched by no step.
    steep_rad = arccos(max(1.0 - step / radius, -1.0))
    count = max(math.ceil(steep_rad / _RIM_STEP_RAD), 1)
    angles: Floats = steep_rad / count * np.arange(-count, count + 1.0)
    rim = np.stack((radius * sin(angles), 0.0 * angles, -radius * (1.0 - cos(angles))), axis=-1)
    places = [np.array((x, y, 0.0)) for x, y in base.wheel_places_m]
    # Within the sides of the body, which touch walls.
    x, y = (0.5 * (size - SKIN_M) for size in base.collision_size_m[:2])
    belly = np.stack(np.meshgrid([-x, 0.0, x], [-y, 0.0, y], [-step]), axis=-1).reshape(-1, 3)
    points = np.concatenate((*(rim + place for place in places), belly))
    return points, step + LIFT_M + points[:, 2], (x, y), step


def _rotate_about(x: float, y: float, angle_rad: float) -> Floats:
    """Rotation about a level unit axis, by Rodrigues' formula."""
    c, s = cos(angle_rad), sin(angle_rad)
    d = 1.0 - c
    return np.array(
        ((c + d * x * x, d * x * y, s * y), (d * x * y, c + d * y * y, -s * x), (-s * y, s * x, c))
    )
