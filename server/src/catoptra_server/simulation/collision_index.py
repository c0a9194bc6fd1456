"""What each robot stands on and meets: the scene, and the boxes of the other robots."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np

from catoptra_protocol.optics.elementary import cos, hypot, matmul, sin
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
# Robots that are as much higher or lower stand on another floor.
_OTHER_FLOOR_M = 1.0


class CollisionIndex:
    """Ground of all robots; the box of a robot is kept until the robot moves."""

    def __init__(self, scene: SceneMesh, caster: RayCaster) -> None:
        """Create the ground of a scene without robots; arguments as of `SceneGround`."""
        self._ground = SceneGround(scene, caster)
        self._boxes: dict[Robot, tuple[OrientedBox, tuple[float, ...], float]] = {}
        self._tabulated: tuple[Robot, ...] = ()
        self._rows: dict[Robot, int] = {}
        self._moved: set[Robot] = set()
        self._places = np.zeros((4, 0))

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
        if robot in self._rows:
            self._moved.add(robot)

    def place(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        z_m: float = 0.0,
        *,
        clearance_m: float = 0.0,
        robots: Iterable[Robot] = (),
    ) -> RobotBody:
        """Base of a class at rest at a place among robots; errors as of `SceneGround.place`.

        A tripod stands anywhere, at the height z_m itself.
        """
        if description.drive.is_tripod:
            where = pose.at_height(-z_m)
            return RobotBody(description.drive, pose, where, is_settled=True)
        return self._ground.place(
            description.drive,
            pose,
            z_m,
            height_m=collision_height_m(description),
            others=self._find_others(description, pose, robots),
            clearance_m=clearance_m,
        )

    def _find_others(
        self, description: RobotDescription, pose: PlanarPose, robots: Iterable[Robot]
    ) -> list[OrientedBox]:
        """Boxes in reach of a place, seen from above."""
        own_m = hypot(*description.drive.collision_size_m[:2])
        found = [self._find_box(robot) for robot in robots if robot.is_solid]
        return [
            box
            for box, (x, y, _), radius_m in found
            if max(abs(x - pose.x_m), abs(y - pose.y_m)) <= own_m + radius_m
        ]

    def may_stand(
        self,
        description: RobotDescription,
        places: Floats,
        yaw_rad: float,
        z_m: float,
        clearance_m: float,
        robots: Iterable[Robot],
    ) -> Bools:
        """(n,) whether a base may have room at (n, 2) places: for all in the time of some of them.

        From above no robot's box overlaps its outline, and as of `SceneGround.may_stand`.
        """
        half_m = 0.5 * np.array(description.drive.collision_size_m[:2]) + clearance_m
        heading = np.array(((cos(yaw_rad), sin(yaw_rad)), (-sin(yaw_rad), cos(yaw_rad))))
        are_open = np.ones(len(places), dtype=bool)
        for robot in filter(lambda one: one.is_solid, robots):
            box, (x, y, z), _ = self._find_box(robot)
            if abs(z - z_m) > _OTHER_FLOOR_M:
                continue
            # Columns: the axes of the box from above, each of half its length.
            sides = box.world_from_box.rotation[:2] * (0.5 * np.array(box.size_m))
            apart = np.zeros(len(places), dtype=bool)
            for axis in (
                *heading,
                *(sides.T[:2] / np.maximum(hypot(*sides[:, :2]), 1e-9)[:, None]),
            ):
                reach_m = np.abs(matmul(axis, sides)).sum() + np.abs(matmul(heading, axis)) @ half_m
                apart |= np.abs(matmul(places - (x, y), axis)) > reach_m
            are_open &= apart
        are_open[are_open] = self._ground.may_stand(
            description.drive, places[are_open], yaw_rad, z_m
        )
        return are_open

    def mover_of(self, robot: Robot, robots: Iterable[Robot]) -> MoveBase:
        """What moves a robot in the next tick, among the robots in reach."""
        if not (robot.may_move and robot.is_solid):  # most robots, most of the time
            return self._ground.move
        robots = tuple(one for one in robots if one.is_solid)
        if len(robots) < 2:
            return self._ground.move
        drive = robot.description.drive
        height_m = collision_height_m(robot.description)
        radius_m = 0.5 * hypot(*drive.collision_size_m[:2]) + height_m * robot.tilt_sine
        radius_m += _MAX_TICK_S * drive.max_speed_rad_s * drive.wheel_radius_m
        places = self._tabulate(robots)
        apart = np.abs(places[:3] - np.array(self._find_box(robot)[1])[:, None])
        reach_m = places[3] + radius_m
        apart[2] -= height_m + _MAX_DROP_M - radius_m
        near = np.flatnonzero((apart <= reach_m).all(axis=0)).tolist()
        others = [self._boxes[robots[n]][0] for n in near if robots[n] is not robot]
        return partial(self._ground.move, others=others) if others else self._ground.move

    def _tabulate(self, robots: tuple[Robot, ...]) -> Floats:
        """(4, n) centres and radii of robots; of those that moved since the last call anew."""
        if robots != self._tabulated:
            self._tabulated, self._places = robots, np.zeros((4, len(robots)))
            self._rows = {robot: row for row, robot in enumerate(robots)}
            self._moved = set(robots)
        for robot in self._moved:
            _, centre, radius_m = self._find_box(robot)
            self._places[:, self._rows[robot]] = (*centre, radius_m)
        self._moved.clear()
        return self._places


def collision_height_m(description: RobotDescription) -> float:
    """Height above the floor up to which a robot meets things."""
    highest_m = max(description.max_viewpoint_height_m, description.drive.collision_size_m[2])
    return highest_m + _MIRROR_ABOVE_VIEWPOINT_M
