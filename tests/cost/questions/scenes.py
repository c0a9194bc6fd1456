"""The scenes that questions about rendering are asked on: the field, and many small triangles."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.camera import OmniCamera, camera_with_rim_inscribed
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_server.config.world_file import read_world
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.description import (
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    SphereBand,
    World,
)

FIELD = Path(__file__).parents[3] / "configs/worlds/four_legged_2006.ini"
EXPOSURE = Exposure(Pose.from_rpy((0.5, 0.3, -0.6), (0.0, 0.0, 0.3)))


def worlds() -> dict[str, World]:
    """Return the field, and 30 balls of 2000 triangles each on a floor."""
    return {"field": read_world(FIELD)[0], "balls": balls()}


def balls() -> World:
    """Return 60 000 triangles, most of them a few pixels large."""
    rng = np.random.default_rng(1)
    items = [Item("floor", Rectangle((20, 20)), Pose.identity(), Material((0.02, 0.25, 0.05)))]
    for index in range(30):
        place = Pose.from_rpy((*rng.uniform(-6.0, 6.0, 2), -rng.uniform(0.0, 1.0)))
        red, green, blue = rng.uniform(0.0, 1.0, 3)
        shape = SphereBand(0.15, 0.0, math.radians(179.0), 50, 20)
        items.append(Item(f"ball {index}", shape, place, Material((red, green, blue))))
    light = HemisphereLight((0.7, 0.7, 0.7), (0.3, 0.3, 0.3))
    return World("balls", tuple(items), lights=(light,), background=(0.3, 0.3, 0.35))


def camera(width_px: int = 640) -> OmniCamera:
    """Return the paper's camera."""
    return camera_with_rim_inscribed(
        HyperbolicMirror(11.546, 0.2321),
        width_px=width_px,
        height_px=width_px,
        rim_rad=math.radians(120.0),
    )
