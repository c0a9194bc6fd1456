"""Dynamic objects for tests: two robots in the world of `helpers.worlds`, unlit boxes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.robot_bodies import (
    OmniCameraTower,
    RobotDimensions,
    build_robot_mesh,
)
from catoptra_server.world import shapes as primitives
from catoptra_server.world.objects import DynamicObject, ObjectMesh, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World
from helpers.worlds import make_omni_camera

P2AT = RobotDimensions((0.5238, 0.4968, 0.2913), 0.1457, 0.13, 0.2884)
ROBOT_MESH = build_robot_mesh(
    P2AT, OmniCameraTower(make_omni_camera(), Pose.from_rpy((0.0, 0.0, -0.4543)))
)
SMOOTH_ROBOT_MESH = build_robot_mesh(
    replace(P2AT, is_smooth=True),
    OmniCameraTower(make_omni_camera(), Pose.from_rpy((0.0, 0.0, -0.4543))),
)
# One ahead of helpers.worlds.CAMERA_STATE before the wall, one behind, partly behind the crate.
TWO_ROBOTS = (
    DynamicObject(ROBOT_MESH, Pose.from_rpy((0.85, 0.4, -0.1457), (0.0, 0.0, 0.8))),
    DynamicObject(ROBOT_MESH, Pose.from_rpy((-1.4, -1.2, -0.1457), (0.0, 0.0, 2.0))),
)
SMOOTH_ROBOTS = tuple(replace(robot, mesh=SMOOTH_ROBOT_MESH) for robot in TWO_ROBOTS)

_WOOD = (0.9, 0.6, 0.3)


@cache
def build_textured_mesh() -> ObjectMesh:
    """Two crates of textures and a mast without."""
    crates = (
        Item("low", Box((0.5, 0.5, 0.3)), Pose.identity(), Material((0.9, 0.9, 0.9), "brick")),
        Item(
            "high", Box((0.3, 0.3, 0.2)), Pose.from_rpy((0, 0, -0.4)), Material(_WOOD, "concrete")
        ),
    )
    mast = primitives.box(Box((0.1, 0.1, 1.0)))
    body = build_scene(World("body", crates))
    return build_object_mesh([(mast, Material((0.2, 0.6, 0.3)))], body=body)


def build_cube_mesh(size_m: float, rgb: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> ObjectMesh:
    """An unlit cube around the object's origin."""
    patch = primitives.box(Box((size_m, size_m, size_m)))
    return build_object_mesh([(patch, Material(rgb, unlit=True))])


def place_cube(x: float, y: float, z: float, *, size_m: float = 0.4) -> DynamicObject:
    """An unlit red cube at a position."""
    return DynamicObject(build_cube_mesh(size_m), Pose.from_rpy((x, y, z)))
