"""Capture of labelled training frames: a robot at random poses, and labels from geometry.

Each pose has a connection of its own, since USARSim sets a robot's pose only when it spawns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks import Viewpoint, label_frame, world_from_mirror
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.robot_client import RobotClient
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera

ROBOT_CLASS = "USARBot.OmniP2AT"
# Half extents of the sampled positions: within the field's lines and off the edges of the route.
_MAX_X_M = 2.0
_MAX_Y_M = 1.3


def capture_training_frames(
    address: ServerAddress,
    *,
    landmarks: tuple[Landmark, ...],
    num_frames: int,
    seed: int,
    on_frame: Callable[[], None],
    robot_class: str = ROBOT_CLASS,
) -> Iterator[tuple[UInt8Array, UInt8Array]]:
    """Yield (h, w, 3) frames from random poses on the field, with their (h, w) labels.

    Args:
        address: server to capture from.
        landmarks: all landmarks of the world.
        num_frames: number of frames.
        seed: seed of the random poses.
        on_frame: called after each frame, for progress.
        robot_class: class to spawn, with a mirror camera.
    """
    generator = np.random.Generator(np.random.Philox(key=seed))
    for number in range(num_frames):
        x = float(generator.uniform(-_MAX_X_M, _MAX_X_M))
        y = float(generator.uniform(-_MAX_Y_M, _MAX_Y_M))
        yaw = float(generator.uniform(-math.pi, math.pi))
        # Unique names: the server may not have removed the previous robot yet.
        yield _capture_training_frame(
            address, landmarks, robot_class, pose=(x, y, yaw), name=f"Trainer{number}"
        )
        on_frame()


def _capture_training_frame(
    address: ServerAddress,
    landmarks: tuple[Landmark, ...],
    robot_class: str,
    *,
    pose: tuple[float, float, float],
    name: str,
) -> tuple[UInt8Array, UInt8Array]:
    x, y, yaw = pose
    with (
        RobotClient.connect(address.host, address.control_port) as robot,
        ImageClient.connect(address.host, address.image_port) as images,
    ):
        robot.spawn(robot_class, name=name, location_m=(x, y, 0.0), rotation_rad=(0.0, 0.0, yaw))
        camera, height_m = robot.get_camera_and_height()
        # A server in real time may still hold a frame of the previous robot; the second is current.
        images.get_frame()
        frame = images.get_frame().rgb
        return frame, _label_image(camera, landmarks, height_m, pose)


# Studies train repeatedly at the same poses, and labels take three times as long as frames.
@lru_cache(maxsize=128)
def _label_image(
    camera: OmniCamera,
    landmarks: tuple[Landmark, ...],
    height_m: float,
    pose: tuple[float, float, float],
) -> UInt8Array:
    mirror = world_from_mirror(Viewpoint(height_m), np.array(pose))
    labels = label_frame(camera, landmarks, world_from_mirror=mirror)
    # Shared between callers through the cache.
    labels.setflags(write=False)
    return labels
