"""What each robot stands on and meets: the scene, and the boxes of the other robots."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.simulation.drive import MoveBase, RobotBody
from catoptra_server.simulation.ground import SceneGround
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import PlanarPose, RobotDescription
from catoptra_server.simulation.sensors import RayCaster
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import SceneMesh

# The mirror rises above the viewpoint: anything up to this height above the viewpoint is touched.
_MIRROR_ABOVE_VIEWPOINT_M = 0.1
# More than a tick of 0.02 s, and what falls in it.
_MAX_TICK_S, _MAX_DROP_M = 0.05, 0.5


class CollisionIndex:
    """Ground of all robots; the box of a robot is kept until the robot moves."""

    def __init__(self, scene: SceneMesh, caster: RayCaster) -> None:
        """Create the ground of a scene without robots; arguments as of `SceneGround`."""
        self._ground = SceneGround(scene, caster)
        self._boxes: dict[Robot, tuple[OrientedBox, tuple[float, ...], float]] = {}

    def bounding_box(self, robot: Robot) -> OrientedBox:
        """Bounding box of a robot at its present pose."""
        return self._find_box(robot)[0]

    def _find_box(self, robot: Robot) -> tuple[OrientedBox, tuple[float, ...], float]:
        """Box, its centre and its radius."""
        found = self._boxes.get(robot)
        if found is None:
            box = robot.bounding_box
            centre = tuple(box.world_from_box.translation.tolist())
            found = self._boxes[robot] = box, centre, 0.5 * hypot(*box.size_m)
        return found

    def invalidate(self, robot: Robot) -> None:
        """Discard the box of a robot that moved or was removed."""
        self._boxes.pop(robot, None)

    def place(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        z_m: float = 0.0,
        *,
        clearance_m: float = 0.0,
        robots: Iterable[Robot] = (),
    ) -> RobotBody:
        """Base of a class at rest at a place among robots; errors as of `SceneGround.place`."""
        return self._ground.place(
            description.drive,
            pose,
            z_m,
            height_m=collision_height_m(description),
            others=[self._find_box(robot)[0] for robot in robots],
            clearance_m=clearance_m,
        )

    def are_open(
        self, description: RobotDescription, places: Floats, robots: Iterable[Robot]
    ) -> Bools:
        """(n,) whether no robot covers the middle of a base at (n, 2) places, seen from above.

        A test without rays: whether the base stands there is another question.
        """
        half_m = 0.5 * min(description.drive.collision_size_m[:2])
        are_open = np.ones(len(places), dtype=bool)
        for robot in robots:
            box, (x, y, _), _ = self._find_box(robot)
            reach_m = half_m + 0.5 * min(box.size_m)
            are_open &= np.square(places - (x, y)).sum(axis=1) >= reach_m * reach_m
        return are_open

    def mover_of(self, robot: Robot, robots: Iterable[Robot]) -> MoveBase:
        """What moves a robot in the next tick, among the robots in reach."""
        if not robot.may_move:  # most robots, most of the time
            return self._ground.move
        robots = tuple(robots)
        if len(robots) < 2:
            return self._ground.move
        _, (x, y, z), _ = self._find_box(robot)
        drive = robot.description.drive
        height_m = collision_height_m(robot.description)
        radius_m = 0.5 * hypot(*drive.collision_size_m[:2]) + height_m * robot.tilt_sine
        radius_m += _MAX_TICK_S * drive.max_speed_rad_s * drive.wheel_radius_m
        others = []
        for other in robots:
            box, (u, v, w), other_m = self._boxes.get(other) or self._find_box(other)
            # A box around the reach: no root for each pair.
            reach_m = radius_m + other_m
            is_beside = abs(u - x) <= reach_m and abs(v - y) <= reach_m
            if is_beside and abs(w - z) <= height_m + other_m + _MAX_DROP_M and other is not robot:
                others.append(box)
        return partial(self._ground.move, others=others) if others else self._ground.move


def collision_height_m(description: RobotDescription) -> float:
    """Height above the floor up to which a robot meets things."""
    highest_m = max(description.max_viewpoint_height_m, description.drive.collision_size_m[2])
    return highest_m + _MIRROR_ABOVE_VIEWPOINT_M
