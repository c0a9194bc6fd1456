"""Who is in whose way: the scene's obstacles at each class's height, and the other robots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.meshes import SceneMesh
from catoptra_server.scene.obstacles import CLEARANCE_M, Obstacles, obstacles_between
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.simulation.spawned_robot import SpawnedRobot

# The mirror rises above the viewpoint; anything lower than this above it is in the way.
_MIRROR_ABOVE_VIEWPOINT_M = 0.1
# A tick moves no robot farther than this: what is farther off than both bodies and this is no
# obstacle. 100 rad/s on a wheel of 1 m would be 2 m a tick.
_FARTHEST_TICK_M = 2.0


class Traffic:
    """Obstacles of each robot, and its own box as long as it has not moved."""

    def __init__(self, scene: SceneMesh, classes: Sequence[RobotDescription]) -> None:
        heights = {description.class_name: _height_m(description) for description in classes}
        of_height = {
            height: obstacles_between(scene, low_m=CLEARANCE_M, high_m=height)
            for height in set(heights.values())
        }
        self._scenery = {name: of_height[height] for name, height in heights.items()}
        self._boxes: dict[SpawnedRobot, OrientedBox] = {}

    def box(self, robot: SpawnedRobot) -> OrientedBox:
        """Return a robot's box where it stands now."""
        if robot not in self._boxes:
            self._boxes[robot] = robot.box
        return self._boxes[robot]

    def forget(self, robot: SpawnedRobot) -> None:
        """Take note that a robot moved, or left."""
        self._boxes.pop(robot, None)

    def around(self, robot: SpawnedRobot, robots: Iterable[SpawnedRobot]) -> Obstacles:
        """Return what may stop a robot in one tick."""
        scenery = self._scenery[robot.description.class_name]
        if not robot.is_rolling:  # nothing stops what stands
            return scenery
        others = [self.box(other) for other in robots if other is not robot]
        return scenery.with_boxes(_near(self.box(robot), others)) if others else scenery


def _height_m(description: RobotDescription) -> float:
    tallest = max(description.viewpoint_height_m, description.drive.body_m[2])
    return tallest + _MIRROR_ABOVE_VIEWPOINT_M


def _near(own: OrientedBox, others: Sequence[OrientedBox]) -> list[OrientedBox]:
    places = np.array([other.world_from_box.translation[:2] for other in others])
    reaches = np.array([np.hypot(*other.size_m[:2]) for other in others])
    away = np.linalg.norm(places - own.world_from_box.translation[:2], axis=1)
    near = away <= 0.5 * (reaches + np.hypot(*own.size_m[:2])) + _FARTHEST_TICK_M
    return [other for other, is_near in zip(others, near, strict=True) if is_near]
