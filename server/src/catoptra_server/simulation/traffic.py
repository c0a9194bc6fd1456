"""Who is in whose way: the scene's obstacles at each class's height, and the other robots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.meshes import SceneMesh
from catoptra_server.scene.obstacles import CLEARANCE_M, Obstacles, box_outline, obstacles_between
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.simulation.spawned_robot import SpawnedRobot

# The mirror rises above the viewpoint; anything lower than this above it is in the way.
_MIRROR_ABOVE_VIEWPOINT_M = 0.1
# No tick is longer: what a robot cannot reach in it is no obstacle.
_LONGEST_TICK_S = 0.05


class _Stand(NamedTuple):
    """Where a robot stands: its box, that box from above, its centre and half its diagonal."""

    box: OrientedBox
    outline: Floats
    x_m: float
    y_m: float
    reach_m: float

    @classmethod
    def of(cls, robot: SpawnedRobot) -> _Stand:
        box = robot.box
        x, y, _ = box.world_from_box.translation.tolist()
        return cls(box, box_outline(box), x, y, 0.5 * math.hypot(*box.size_m[:2]))


class Traffic:
    """Obstacles of each robot, and its own box as long as it has not moved."""

    def __init__(self, scene: SceneMesh, classes: Sequence[RobotDescription]) -> None:
        heights = {description.class_name: _height_m(description) for description in classes}
        of_height = {
            height: obstacles_between(scene, low_m=CLEARANCE_M, high_m=height)
            for height in set(heights.values())
        }
        self._scenery = {name: of_height[height] for name, height in heights.items()}
        self._stands: dict[SpawnedRobot, _Stand] = {}

    def box(self, robot: SpawnedRobot) -> OrientedBox:
        """Return a robot's box where it stands now."""
        return self._stand(robot).box

    def _stand(self, robot: SpawnedRobot) -> _Stand:
        if robot not in self._stands:
            self._stands[robot] = _Stand.of(robot)
        return self._stands[robot]

    def forget(self, robot: SpawnedRobot) -> None:
        """Take note that a robot moved, or left."""
        self._stands.pop(robot, None)

    def around(self, robot: SpawnedRobot, robots: Iterable[SpawnedRobot]) -> Obstacles:
        """Return what may stop a robot in one tick."""
        scenery = self._scenery[robot.description.class_name]
        if not robot.is_rolling:  # nothing stops what stands
            return scenery
        own, drive = self._stand(robot), robot.description.drive
        reach_m = own.reach_m + _LONGEST_TICK_S * drive.max_speed_rad_s * drive.wheel_radius_m
        stands = [self._stands.get(other) or self._stand(other) for other in robots]
        return scenery.with_outlines(
            [
                stand.outline
                for stand in stands
                if abs(stand.x_m - own.x_m) <= (reach := reach_m + stand.reach_m)
                and abs(stand.y_m - own.y_m) <= reach
                and stand is not own
            ]
        )


def _height_m(description: RobotDescription) -> float:
    tallest = max(description.viewpoint_height_m, description.drive.body_m[2])
    return tallest + _MIRROR_ABOVE_VIEWPOINT_M
