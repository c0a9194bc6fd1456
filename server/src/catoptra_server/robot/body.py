"""A robot that is alive: where it is, how its wheels spin, and what stops it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.description import DriveBase
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.robot.skid_steer import AT_REST, Rolled, WheelSpin, moved, rolled, slipped
from catoptra_server.scene.obstacles import Obstacles, Outline, rectangle_touches

# Halvings of a tick's motion up to the wall: 2^-7 of at most 14 mm is a tenth of a millimetre.
_HALVINGS = 7


@dataclass(frozen=True, slots=True)
class Body:
    """A base at a place with spinning wheels. `tick` counts its moves and keys its random slip."""

    base: DriveBase
    pose: PlanarPose
    spin: WheelSpin
    tick: int = 0


def driven(
    body: Body, duration_s: float, *, obstacles: Obstacles, stream: RandomStream
) -> tuple[Body, Rolled]:
    """Return the body after a short time, and what its wheels rolled.

    At an obstacle the base stops as close as it gets; its wheels roll on, as encoders would tell.
    """
    way = rolled(body.base, body.spin, duration_s)
    pose = body.pose
    if way != AT_REST:
        real = slipped(body.base, way, stream.at(body.tick))
        pose = _until_contact(body, real, obstacles)
    return Body(body.base, pose, body.spin, body.tick + 1), way


def _until_contact(body: Body, way: Rolled, obstacles: Obstacles) -> PlanarPose:
    """Return where the base ends: the whole way if it is free, else the free part of it.

    A base that already touches something (spawned there, or pushed by rounding) moves freely, so
    that it can get away.
    """
    turn = way.turn_rad(body.base)
    if not (way.left_m or way.right_m):  # most robots stand most of the time
        return body.pose
    near = _Near.of(body, abs(way.distance_m), obstacles)
    if near.is_touched_from(body.pose):
        return moved(body.pose, way.distance_m, turn)
    # No step is longer than half the base: it cannot jump over a wall.
    steps = math.ceil(abs(way.distance_m) / (0.5 * min(body.base.body_m[:2]))) or 1
    pose = body.pose
    for _ in range(steps):
        goal = moved(pose, way.distance_m / steps, turn / steps)
        if near.is_touched_from(goal):
            return _last_free(pose, (way.distance_m / steps, turn / steps), near)
        pose = goal
    return pose


@dataclass(frozen=True, slots=True)
class _Near:
    """What a base can touch within a tick, looked up once, and half its length and width."""

    outlines: Sequence[Outline]
    half_size_m: tuple[float, float]

    @classmethod
    def of(cls, body: Body, distance_m: float, obstacles: Obstacles) -> _Near:
        half = (0.5 * body.base.body_m[0], 0.5 * body.base.body_m[1])
        place = (body.pose.x_m, body.pose.y_m)
        return cls(obstacles.near(place, math.hypot(*half) + distance_m), half)

    def is_touched_from(self, pose: PlanarPose) -> bool:
        place = (pose.x_m, pose.y_m)
        return rectangle_touches(self.outlines, place, pose.yaw_rad, half_size_m=self.half_size_m)


def _last_free(pose: PlanarPose, step: tuple[float, float], near: _Near) -> PlanarPose:
    """Return the last free pose of a step (metres, radians) that ends in an obstacle."""
    distance_m, turn_rad = step
    free, blocked = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (free + blocked)
        if near.is_touched_from(moved(pose, middle * distance_m, middle * turn_rad)):
            blocked = middle
        else:
            free = middle
    return moved(pose, free * distance_m, free * turn_rad)
