"""Obstacles of each robot: the scene at the heights of the robot's class, and the other robots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.obstacle_grid import (
    GROUND_CLEARANCE_M,
    ObstacleGrid,
    box_footprint,
    build_obstacle_grid,
    rectangles_intersect,
)
from catoptra_server.world.scene_mesh import SceneMesh

# The mirror rises above the viewpoint: anything up to this height above the viewpoint is touched.
_MIRROR_ABOVE_VIEWPOINT_M = 0.1
# More than a tick of 0.02 s: a robot out of reach in this time is no obstacle in the next tick.
_MAX_TICK_S = 0.05


class _Footprint(NamedTuple):
    """Bounding box of a robot and its outline seen from above."""

    box: OrientedBox
    outline: Floats
    x_m: float
    y_m: float
    radius_m: float

    @classmethod
    def from_robot(cls, robot: Robot) -> _Footprint:
        box = robot.bounding_box
        x, y, _ = box.world_from_box.translation.tolist()
        return cls(box, box_footprint(box), x, y, 0.5 * hypot(*box.size_m[:2]))


class CollisionIndex:
    """Obstacles of all robots; the footprint of a robot is kept until the robot moves."""

    def __init__(self, scene: SceneMesh, classes: Sequence[RobotDescription]) -> None:
        self._static_obstacles = _build_grids(scene, classes)
        self._footprints: dict[Robot, _Footprint] = {}

    def bounding_box(self, robot: Robot) -> OrientedBox:
        """Bounding box of a robot at its present pose."""
        return self._footprint(robot).box

    def _footprint(self, robot: Robot) -> _Footprint:
        if robot not in self._footprints:
            self._footprints[robot] = _Footprint.from_robot(robot)
        return self._footprints[robot]

    def invalidate(self, robot: Robot) -> None:
        """Discard the footprint of a robot that moved or was removed."""
        self._footprints.pop(robot, None)

    def are_free(
        self,
        description: RobotDescription,
        places: Floats,
        clearance_m: float,
        *,
        yaw_rad: float,
        robots: Iterable[Robot],
    ) -> Bools:
        """Whether the base of a class would touch neither the scene nor a robot at places.

        Args:
            description: Class of the base.
            places: (n, 2) centres of the base, metres, world frame.
            clearance_m: Distance that must be free around the base.
            yaw_rad: Heading of the base.
            robots: Robots to be avoided.

        Returns:
            (n,) True for a free place.
        """
        length_m, width_m = description.drive.collision_size_m[:2]
        half_m = (0.5 * length_m + clearance_m, 0.5 * width_m + clearance_m)
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        reach_m = float(np.abs(places - middle).max()) + hypot(*half_m)
        x, y = middle.tolist()
        obstacles = self._static_obstacles[description.class_name].with_dynamic_triangles(
            [self._footprint(robot).outline for robot in robots]
        )
        triangles = obstacles.triangles_near((x, y), reach_m)
        return ~rectangles_intersect(triangles, places, yaw_rad, half_size_m=half_m)

    def obstacles_near(self, robot: Robot, robots: Iterable[Robot]) -> ObstacleGrid:
        """Obstacles that a robot may touch in the next tick: the scene, and robots in reach."""
        scene_obstacles = self._static_obstacles[robot.class_name]
        if not robot.is_rolling:  # most robots, most of the time
            return scene_obstacles
        robots = tuple(robots)
        if len(robots) < 2:  # a footprint takes a quarter of a tick
            return scene_obstacles
        own, drive = self._footprint(robot), robot.description.drive
        reach_m = own.radius_m + _MAX_TICK_S * drive.max_speed_rad_s * drive.wheel_radius_m
        footprints = [self._footprints.get(other) or self._footprint(other) for other in robots]
        return scene_obstacles.with_dynamic_triangles(
            [
                footprint.outline
                for footprint in footprints
                # A square around the circle of reach: two comparisons, no root, for each pair.
                if abs(footprint.x_m - own.x_m) <= (reach := reach_m + footprint.radius_m)
                and abs(footprint.y_m - own.y_m) <= reach
                and footprint is not own
            ]
        )


def _build_grids(scene: SceneMesh, classes: Sequence[RobotDescription]) -> dict[str, ObstacleGrid]:
    """Obstacles in a scene by class."""
    heights = {description.class_name: collision_height_m(description) for description in classes}
    # Classes of one height share a grid, and what is found in it.
    grids = {
        height: build_obstacle_grid(scene, low_m=GROUND_CLEARANCE_M, high_m=height)
        for height in set(heights.values())
    }
    return {name: grids[height] for name, height in heights.items()}


def collision_height_m(description: RobotDescription) -> float:
    """Height above the floor up to which a robot meets things."""
    highest_m = max(description.max_viewpoint_height_m, description.drive.collision_size_m[2])
    return highest_m + _MIRROR_ABOVE_VIEWPOINT_M
