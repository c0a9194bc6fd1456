"""Perspective pictures of shipped worlds from free poses, and how much structure they have."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.ground import NoStandError
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.objects import CameraState
from helpers.configs import OMNI_ROBOT, WORLDS

PLACES = {
    "laboratory": (4.8, 3.8),
    "offices": (9.8, 6.8),
    "rescue_site": (6.8, 5.8),
    "warehouse_stocked": (7.8, 4.8),
    "yard": (9.0, 9.0),
}
"""Half the sides of where poses are drawn, by world."""
CAMERA_HEIGHT_M = 0.6
Picture = npt.NDArray[np.uint8]


def load_world(name: str) -> StartupConfig:
    """A shipped world with its light, and the P2AT."""
    return read_startup_config([OMNI_ROBOT], WORLDS / f"{name}.ini")


def find_free_poses(startup: StartupConfig, name: str, count: int) -> list[Pose]:
    """Poses of a level camera at random places where the robot has room."""
    index = CollisionIndex(startup.scene, commit_ray_caster(startup.scene))
    random, poses = np.random.default_rng(43), []
    while len(poses) < count:
        share_x, share_y, turn = random.uniform(-1.0, 1.0, 3).tolist()
        x, y, yaw = share_x * PLACES[name][0], share_y * PLACES[name][1], math.pi * turn
        try:
            body = index.place(startup.robots[0], PlanarPose(x, y, yaw), 0.0)
        except NoStandError:
            continue
        if (body.pose.x_m, body.pose.y_m) == (x, y):
            poses.append(Pose.from_rpy((x, y, -CAMERA_HEIGHT_M), (0.0, 0.0, yaw)))
    return poses


def render_perspective(
    startup: StartupConfig, camera: PerspectiveCamera, poses: Sequence[Pose]
) -> list[Picture]:
    """Pictures from poses, with shadows and gloss, without noise."""
    renderer = TraceRenderer(startup.scene, startup.world)
    view = renderer.prepare_perspective(camera, 2)
    states = [CameraState(pose, has_shadows=True, has_gloss=True) for pose in poses]
    pictures = [view.render(state).rgb for state in states]
    view.close()
    renderer.close()
    return pictures


def measure_structure(picture: Picture) -> tuple[float, float, float]:
    """Share of flat blocks of 8 x 8 px, entropy of the greys in bit, share of greys at the ends."""
    grey = picture.astype(np.float64) @ (0.299, 0.587, 0.114)
    height, width = (8 * (side // 8) for side in grey.shape)
    blocks = grey[:height, :width].reshape(height // 8, 8, width // 8, 8)
    flat = float((blocks.std(axis=(1, 3)) < 0.6).mean())
    shares = np.bincount(grey.astype(np.intp).ravel(), minlength=256) / grey.size
    bits = float(-(shares[shares > 0] * np.log2(shares[shares > 0])).sum())
    return flat, bits, float(((grey < 5) | (grey > 250)).mean())
