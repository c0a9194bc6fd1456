"""A robot that is alive: where it is, how its wheels spin, and what stops it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_server.random_sources import RandomSource
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
from catoptra_server.scene.obstacle_grid import ObstacleGrid, Triangle2D, rectangle_intersects

# Halvings of a tick's motion up to the wall: 2^-7 of at most 14 mm is a tenth of a millimetre.
_BISECTION_STEPS = 7


@dataclass(frozen=True, slots=True)
class RobotBody:
    """A base at a place with spinning wheels. `tick` counts its moves and keys its random slip."""

    base: DriveBase
    pose: PlanarPose
    spin: WheelSpin
    tick: int = 0


def step(
    body: RobotBody, duration_s: float, *, obstacles: ObstacleGrid, stream: RandomSource
) -> tuple[RobotBody, WheelTravel]:
    """Return the body after a short time, and what its wheels rolled.

    At an obstacle the base stops as close as it gets; its wheels roll on, as encoders would tell.
    """
    way = wheel_travel(body.base, body.spin, duration_s)
    pose = body.pose
    if way != NO_TRAVEL:
        real = apply_slip(body.base, way, stream.generator(body.tick))
        pose = _move_until_contact(body, real, obstacles)
    return RobotBody(body.base, pose, body.spin, body.tick + 1), way


def _move_until_contact(
    body: RobotBody, travel: WheelTravel, obstacles: ObstacleGrid
) -> PlanarPose:
    """Return where the base ends: the whole way if it is free, else the free part of it.

    A base that already touches something (spawned there, or pushed by rounding) moves freely, so
    that it can get away.
    """
    turn = travel.turn_rad(body.base)
    if not (travel.left_m or travel.right_m):  # most robots stand most of the time
        return body.pose
    near = _NearbyObstacles.around_body(body, abs(travel.distance_m), obstacles)
    if near.has_contact_at(body.pose):
        return integrate_arc(body.pose, travel.distance_m, turn)
    # No step is longer than half the base: it cannot jump over a wall.
    steps = math.ceil(abs(travel.distance_m) / (0.5 * min(body.base.collision_size_m[:2]))) or 1
    pose = body.pose
    for _ in range(steps):
        goal = integrate_arc(pose, travel.distance_m / steps, turn / steps)
        if near.has_contact_at(goal):
            return _last_free_pose(pose, (travel.distance_m / steps, turn / steps), near)
        pose = goal
    return pose


@dataclass(frozen=True, slots=True)
class _NearbyObstacles:
    """What a base can touch within a tick, looked up once, and half its length and width."""

    outlines: Sequence[Triangle2D]
    half_size_m: tuple[float, float]

    @classmethod
    def around_body(
        cls, body: RobotBody, distance_m: float, obstacles: ObstacleGrid
    ) -> _NearbyObstacles:
        half = (0.5 * body.base.collision_size_m[0], 0.5 * body.base.collision_size_m[1])
        place = (body.pose.x_m, body.pose.y_m)
        return cls(obstacles.find_near(place, math.hypot(*half) + distance_m), half)

    def has_contact_at(self, pose: PlanarPose) -> bool:
        place = (pose.x_m, pose.y_m)
        return rectangle_intersects(
            self.outlines, place, pose.yaw_rad, half_size_m=self.half_size_m
        )


def _last_free_pose(
    pose: PlanarPose, arc: tuple[float, float], obstacles: _NearbyObstacles
) -> PlanarPose:
    """Return the last free pose of a step (metres, radians) that ends in an obstacle."""
    distance_m, turn_rad = arc
    free, blocked = 0.0, 1.0
    for _ in range(_BISECTION_STEPS):
        middle = 0.5 * (free + blocked)
        if obstacles.has_contact_at(integrate_arc(pose, middle * distance_m, middle * turn_rad)):
            blocked = middle
        else:
            free = middle
    return integrate_arc(pose, free * distance_m, free * turn_rad)
