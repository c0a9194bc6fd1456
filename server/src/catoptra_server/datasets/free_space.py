"""Free space of a robot in a world: where it stands on a floor, touches nothing and is in nothing.

Contact is that of driving robots (`simulation/collision_index.py`), seen from above. Two rays more
tell what outlines cannot: one down for the floor, and level ones for the inside of a solid, whose
surface is met from behind on all sides.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.datasets.dataset_stage import RecipeCamera, RecipeWorld
from catoptra_server.datasets.recipe import RandomPoses, ValueRange
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.obstacle_grid import GROUND_CLEARANCE_M

_NUM_LEVEL_RAYS = 8
# Above sills and carpets, which robots drive over.
_RAY_HEIGHT_M = 0.1


def find_fault(
    world: RecipeWorld, camera: RecipeCamera, pose: PlanarPose, clearance_m: float = 0.0
) -> str:
    """Why a robot cannot stand at a pose; empty for a free one."""
    place = np.array([[pose.x_m, pose.y_m]])
    is_free = world.obstacles.are_free(
        camera.robot, place, clearance_m, yaw_rad=pose.yaw_rad, robots=()
    )
    if not bool(is_free[0]):
        return "the robot touches an obstacle"
    if world.has_floor and not _has_floor(world, pose):
        return "there is no floor below"
    return "it is inside a solid" if _is_inside_solid(world, pose) else ""


def _has_floor(world: RecipeWorld, pose: PlanarPose) -> bool:
    down = np.array([[0.0, 0.0, 1.0]])
    distance_m = world.caster.distances(_origin(pose), down)[0]
    return bool(abs(distance_m - _RAY_HEIGHT_M) <= GROUND_CLEARANCE_M)


def _is_inside_solid(world: RecipeWorld, pose: PlanarPose) -> bool:
    angles = np.arange(_NUM_LEVEL_RAYS) * (2.0 * math.pi / _NUM_LEVEL_RAYS)
    rays = np.stack((np.cos(angles), np.sin(angles), np.zeros(_NUM_LEVEL_RAYS)), axis=-1)
    origins = np.repeat(_origin(pose), _NUM_LEVEL_RAYS, axis=0)
    distances, normals = world.caster.closest_hits(origins, rays)
    is_back = np.isfinite(distances) & (np.einsum("ri,ri->r", normals, rays) > 0.0)
    return bool(is_back.all())


def _origin(pose: PlanarPose) -> Floats:
    return np.array([[pose.x_m, pose.y_m, -_RAY_HEIGHT_M]])


def draw_free_pose(
    world: RecipeWorld, camera: RecipeCamera, poses: RandomPoses, generator: np.random.Generator
) -> PlanarPose:
    """Random pose in free space, uniform over the allowed area.

    Raises:
        CatoptraError: No free pose within the tries that the recipe allows.
    """
    low, high = world.scene.box_min, world.scene.box_max
    x_m = poses.x_m or ValueRange(float(low[0]), float(high[0]))
    y_m = poses.y_m or ValueRange(float(low[1]), float(high[1]))
    fault = ""
    for _ in range(poses.max_tries):
        # Three numbers a try, so that the next try does not depend on the reason of this one.
        pose = PlanarPose(*(values.draw(generator) for values in (x_m, y_m, poses.yaw_rad)))
        fault = find_fault(world, camera, pose, poses.clearance_m)
        if not fault:
            return pose
    raise CatoptraError(
        f"{poses.where}: no free pose for {camera.robot.class_name} in world {world.name} within "
        f"{poses.max_tries} tries (the last one: {fault}); give X= and Y= a free area, lower "
        "Clearance or raise MaxTries"
    )
