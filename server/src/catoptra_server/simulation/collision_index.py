"""Who is in whose way: the scene's obstacles at each class's height, and the other robots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.obstacle_grid import (
    GROUND_CLEARANCE_M,
    ObstacleGrid,
    box_footprint,
    build_obstacle_grid,
)
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.simulation.robot import Robot

# The mirror rises above the viewpoint; anything lower than this above it is in the way.
_MIRROR_ABOVE_VIEWPOINT_M = 0.1
# No tick is longer: what a robot cannot reach in it is no obstacle.
_MAX_TICK_S = 0.05


class _Footprint(NamedTuple):
    """Where a robot stands: its box, that box from above, its centre and half its diagonal."""

    box: OrientedBox
    outline: Floats
    x_m: float
    y_m: float
    radius_m: float

    @classmethod
    def from_robot(cls, robot: Robot) -> _Footprint:
        box = robot.bounding_box
        x, y, _ = box.world_from_box.translation.tolist()
        return cls(box, box_footprint(box), x, y, 0.5 * math.hypot(*box.size_m[:2]))


class CollisionIndex:
    """Obstacles of each robot, and its own box as long as it has not moved."""

    def __init__(self, scene: SceneMesh, classes: Sequence[RobotDescription]) -> None:
        heights = {
            description.class_name: _collision_height_m(description) for description in classes
        }
        of_height = {
            height: build_obstacle_grid(scene, low_m=GROUND_CLEARANCE_M, high_m=height)
            for height in set(heights.values())
        }
        self._static_obstacles = {name: of_height[height] for name, height in heights.items()}
        self._footprints: dict[Robot, _Footprint] = {}

    def bounding_box(self, robot: Robot) -> OrientedBox:
        """Return a robot's box where it stands now."""
        return self._footprint(robot).box

    def _footprint(self, robot: Robot) -> _Footprint:
        if robot not in self._footprints:
            self._footprints[robot] = _Footprint.from_robot(robot)
        return self._footprints[robot]

    def invalidate(self, robot: Robot) -> None:
        """Take note that a robot moved, or left."""
        self._footprints.pop(robot, None)

    def obstacles_near(self, robot: Robot, robots: Iterable[Robot]) -> ObstacleGrid:
        """Return what may stop a robot in one tick."""
        scenery = self._static_obstacles[robot.description.class_name]
        if not robot.is_rolling:  # nothing stops what stands
            return scenery
        own, drive = self._footprint(robot), robot.description.drive
        reach_m = own.radius_m + _MAX_TICK_S * drive.max_speed_rad_s * drive.wheel_radius_m
        stands = [self._footprints.get(other) or self._footprint(other) for other in robots]
        return scenery.with_dynamic_triangles(
            [
                stand.outline
                for stand in stands
                if abs(stand.x_m - own.x_m) <= (reach := reach_m + stand.radius_m)
                and abs(stand.y_m - own.y_m) <= reach
                and stand is not own
            ]
        )


def _collision_height_m(description: RobotDescription) -> float:
    tallest = max(description.viewpoint_height_m, description.drive.collision_size_m[2])
    return tallest + _MIRROR_ABOVE_VIEWPOINT_M
