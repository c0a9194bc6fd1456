"""Motion of a robot's base for one tick, with wheel slip, up to the first contact."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_description import DriveBase
from catoptra_server.robot.skid_steer import (
    NO_TRAVEL,
    WheelSpin,
    WheelTravel,
    apply_slip,
    integrate_arc,
    wheel_travel,
)
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.world.obstacle_grid import (
    ObstacleGrid,
    Triangle2D,
    penetration_depths,
    rectangle_intersects,
)

# Halvings of a tick's motion towards the wall: 2^-7 of at most 14 mm is a tenth of a millimetre.
_BISECTION_STEPS = 7
# Depth up to which a base only touches: two robots compute their contact in axes of their own, and
# coordinates of 1e5 m round to 1.5e-11 m. A hundredth of the distance that bisection leaves.
_TOUCH_M = 1e-6


@dataclass(frozen=True, slots=True)
class RobotBody:
    """State of a base."""

    base: DriveBase
    pose: PlanarPose
    spin: WheelSpin
    tick: int = 0
    """Number of ticks simulated; index of the random slip."""


def step_body(
    body: RobotBody, duration_s: float, *, obstacles: ObstacleGrid, random_source: RandomSource
) -> tuple[RobotBody, WheelTravel]:
    """Move a base by one tick.

    At an obstacle the base stops within a tenth of a millimetre while the wheels roll on, as
    encoders of a blocked robot measure. A base that starts in contact only moves to where the
    contact is less deep: never through an obstacle, and never into another one.

    Args:
        random_source: Source of the random slip.

    Returns:
        The base after the tick, and the travel of the wheels before slip.
    """
    travel = wheel_travel(body.base, body.spin, duration_s)
    pose = body.pose
    if travel != NO_TRAVEL:
        # Random numbers by tick: a drive repeats itself whatever other robots do.
        travel_on_floor = apply_slip(body.base, travel, random_source.generator(body.tick))
        pose = _move_until_contact(body, travel_on_floor, obstacles)
    return RobotBody(body.base, pose, body.spin, body.tick + 1), travel


def _move_until_contact(
    body: RobotBody, travel: WheelTravel, obstacles: ObstacleGrid
) -> PlanarPose:
    """Pose at the end of the travel, or before the first contact."""
    turn_rad = travel.turn_rad(body.base)
    if not (travel.left_m or travel.right_m):  # most robots stand most of the time
        return body.pose
    nearby = _NearbyObstacles.around_body(body, abs(travel.distance_m), obstacles)
    is_blocked = nearby.blocking_rule(body.pose)
    # No step is longer than half the base: the base cannot jump over a wall.
    steps = math.ceil(abs(travel.distance_m) / (0.5 * min(body.base.collision_size_m[:2]))) or 1
    arc = (travel.distance_m / steps, turn_rad / steps)
    pose = body.pose
    for _ in range(steps):
        goal = integrate_arc(pose, *arc)
        if is_blocked(goal):
            return _last_free_pose(pose, arc, is_blocked)
        pose = goal
    return pose


# Whether obstacles keep a base from a pose.
_BlockingRule = Callable[[PlanarPose], bool]


@dataclass(frozen=True, slots=True)
class _NearbyObstacles:
    """Obstacles within reach of a base in one tick, looked up once, and half the base's size."""

    outlines: Sequence[Triangle2D]
    half_size_m: tuple[float, float]

    @classmethod
    def around_body(
        cls, body: RobotBody, distance_m: float, obstacles: ObstacleGrid
    ) -> _NearbyObstacles:
        half = (0.5 * body.base.collision_size_m[0], 0.5 * body.base.collision_size_m[1])
        centre = (body.pose.x_m, body.pose.y_m)
        return cls(obstacles.find_near(centre, math.hypot(*half) + distance_m), half)

    def blocking_rule(self, start: PlanarPose) -> _BlockingRule:
        """Rule for a base that starts at a pose: no contact, or no deeper contact than there."""
        if not self.has_contact_at(start):
            return self.has_contact_at
        return partial(self._is_deeper_than, self._depths_at(start))

    def has_contact_at(self, pose: PlanarPose) -> bool:
        centre = (pose.x_m, pose.y_m)
        return rectangle_intersects(
            self.outlines, centre, pose.yaw_rad, half_size_m=self.half_size_m
        )

    def _is_deeper_than(self, before_m: Sequence[float], pose: PlanarPose) -> bool:
        """Whether a pose leaves a base no less deep in obstacles, or deeper in any of them."""
        depths_m = self._depths_at(pose)
        if max(depths_m) <= _TOUCH_M:
            return False
        # For each obstacle alone, too: on the way out of a deep one no other is entered.
        return max(depths_m) >= max(before_m) or any(
            after > max(before, _TOUCH_M) for before, after in zip(before_m, depths_m, strict=True)
        )

    def _depths_at(self, pose: PlanarPose) -> list[float]:
        centre = (pose.x_m, pose.y_m)
        return penetration_depths(self.outlines, centre, pose.yaw_rad, half_size_m=self.half_size_m)


def _last_free_pose(
    pose: PlanarPose, arc: tuple[float, float], is_blocked: _BlockingRule
) -> PlanarPose:
    """Last pose that is not blocked on an arc (metres, radians) whose end is."""
    distance_m, turn_rad = arc
    free, blocked = 0.0, 1.0
    for _ in range(_BISECTION_STEPS):
        fraction = 0.5 * (free + blocked)
        if is_blocked(integrate_arc(pose, fraction * distance_m, fraction * turn_rad)):
            blocked = fraction
        else:
            free = fraction
    return integrate_arc(pose, free * distance_m, free * turn_rad)
