"""Scenes of the measurements: the field, others with many small triangles, robots in view."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.simulation.robot_bodies import (
    OmniCameraTower,
    RobotDimensions,
    build_robot_mesh,
)
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.world_description import (
    Box,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    SphereBand,
    World,
)

FIELD = Path(__file__).parents[2] / "configs/worlds/four_legged_2006.ini"
CORRIDOR = FIELD.parent / "corridor.ini"
CAMERA_STATE = CameraState(Pose.from_rpy((0.5, 0.3, -0.6), (0.0, 0.0, 0.3)))


def make_worlds() -> dict[str, World]:
    """Return the field, and 30 balls of 2000 triangles each on a floor."""
    return {"field": read_world(FIELD)[0], "balls": make_balls()}


def make_worlds_with_million_triangles() -> dict[str, World]:
    """The worlds of `make_worlds`, and 500 balls on a floor."""
    return {**make_worlds(), "million": make_balls(500)}


def make_balls(count: int = 30, *, sectors: int = 50, rings: int = 20) -> World:
    """Balls on a floor: 60 000 triangles by default, most of them a few pixels large."""
    rng = np.random.default_rng(1)
    items = [Item("floor", Rectangle((20, 20)), Pose.identity(), Material((0.02, 0.25, 0.05)))]
    for index in range(count):
        pose = Pose.from_rpy((*rng.uniform(-6.0, 6.0, 2), -rng.uniform(0.0, 1.0)))
        red, green, blue = rng.uniform(0.0, 1.0, 3)
        shape = SphereBand(0.15, 0.0, math.radians(179.0), sectors, rings)
        items.append(Item(f"ball {index}", shape, pose, Material((red, green, blue))))
    light = HemisphereLight((0.7, 0.7, 0.7), (0.3, 0.3, 0.3))
    return World("balls", tuple(items), lights=(light,), background=(0.3, 0.3, 0.35))


def make_thin_objects_world() -> World:
    """Objects that sparse rays may miss: bars of 5 mm, wires of 1 mm, confetti."""
    rng = np.random.default_rng(2)
    white, red = Material((0.9, 0.9, 0.9), unlit=True), Material((0.9, 0.1, 0.1), unlit=True)
    items = [Item("floor", Rectangle((20, 20)), Pose.identity(), Material((0.02, 0.25, 0.05)))]
    for index in range(100):
        angle = 2.0 * math.pi * index / 100
        for radius, width, shift in ((2.0, 0.005, 0.0), (3.0, 0.001, 0.5)):
            turned = angle + shift * 2.0 * math.pi / 100
            location_m = (radius * math.cos(turned), radius * math.sin(turned), -0.5)
            pose = Pose.from_rpy(location_m, (0.0, 0.0, turned))
            items.append(Item(f"bar {radius} {index}", Box((width, width, 1.0)), pose, white))
    for index in range(300):
        location_m = (*rng.uniform(-3.0, 3.0, 2), -rng.uniform(0.0, 1.2))
        pose = Pose.from_rpy(location_m, tuple(rng.uniform(-3.0, 3.0, 3)))
        items.append(Item(f"confetto {index}", Rectangle((0.006, 0.006)), pose, red))
    return World("fence", tuple(items), background=(0.3, 0.3, 0.35))


def make_camera(width_px: int = 640) -> OmniCamera:
    """The paper's camera."""
    return camera_with_inscribed_rim(
        PAPER_MIRROR, width_px=width_px, height_px=width_px, rim_rad=math.radians(120.0)
    )


P2AT = RobotDimensions((0.5238, 0.4968, 0.2913), 0.1457, 0.13, 0.2884)
ROBOT = build_robot_mesh(P2AT, OmniCameraTower(make_camera(), Pose.from_rpy((0.0, 0.0, -0.4543))))


def make_robots(count: int, *, turn_rad: float = 0.0) -> tuple[DynamicObject, ...]:
    """Robots around CAMERA_STATE, at distances from 0.9 m to 2.4 m, each turned on its spot."""
    x, y, _ = CAMERA_STATE.world_from_mirror.translation
    robots = []
    for index in range(count):
        # The golden angle spreads bearings evenly.
        bearing, distance = 2.4 * index, 0.9 + 0.1 * index
        location_m = (x + distance * math.cos(bearing), y + distance * math.sin(bearing), -0.1457)
        pose = Pose.from_rpy(location_m, (0.0, 0.0, 3.0 * bearing + turn_rad))
        robots.append(DynamicObject(ROBOT, pose))
    return tuple(robots)
