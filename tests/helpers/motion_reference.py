"""Camera states in motion, and the mean of many sharp frames of them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.render.renderer import View
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.world_description import Twist, srgb_from_linear
from helpers.effect_measurement import DYNAMIC_OBJECT

# Inside each world, off every axis, at the height of the P2AT's mirror.
START_POSES = {
    "four_legged_2006": Pose.from_rpy((0.5, 0.3, -0.6), (0.0, 0.0, 0.3)),
    "corridor": Pose.from_rpy((0.2, 0.1, -0.6), (0.0, 0.0, 0.2)),
}


def load_world_setup(name: str) -> StartupConfig:
    """The P2AT in a bundled world."""
    return read_startup_config(
        [find_configuration("robots", "p2at_omni")], find_configuration("worlds", name)
    )


def driving_camera_state(
    start: Pose, speed_m_s: float, turn_deg_s: float, *objects: DynamicObject
) -> CameraState:
    """Camera state of a robot that drives ahead and turns."""
    ahead = start.rotation @ np.array([speed_m_s, 0.0, 0.0])
    twist = Twist((*ahead.tolist(),), (0.0, 0.0, math.radians(turn_deg_s)))
    return CameraState(start, objects, twist=twist)


def crossing_object(start: Pose, speed_m_s: float = 0.6) -> DynamicObject:
    """An object ahead to the right that crosses the robot's path and turns."""
    pose = start @ Pose.from_rpy((0.9, 0.5, 0.3))
    return replace(
        DYNAMIC_OBJECT, world_from_object=pose, twist=Twist((0.0, -speed_m_s, 0.0), (0.0, 0.0, 1.0))
    )


def displacements_px(camera: OmniCamera, twist: Twist, range_m: Floats, time_s: Floats) -> Floats:
    """(h, w, 2) displacement by the camera model, after some seconds, of the surface at each pixel.

    twist: of the surface relative to the viewpoint, mirror frame. range_m, time_s: broadcast to (h,
    w). NaN where the surface leaves the mirror.
    """
    pixels = pixel_sample_positions(camera)[..., 0, :]
    directions, on_mirror = direction_from_pixel(camera, pixels)
    where = np.broadcast_to(time_s, on_mirror.shape)
    points = np.where(np.isfinite(range_m), range_m, 1e9)[..., None] * directions
    moved = np.empty_like(points)
    for time in np.unique(where):
        at = where == time
        moved[at] = twist.integrate_pose(Pose.identity(), float(time)).transform_points(points[at])
    after_px, is_seen = pixel_from_direction(camera, moved)
    both = (on_mirror & is_seen)[..., None]
    return np.where(both, after_px - pixels, np.nan)


def relative_twist(camera_state: CameraState, dynamic_object: DynamicObject) -> Twist:
    """An object's motion relative to the camera, at the viewpoint, mirror frame."""
    mirror = camera_state.world_from_mirror
    object_twist = dynamic_object.twist.at_offset(
        mirror.translation - dynamic_object.world_from_object.translation
    )
    return object_twist.relative_to(camera_state.twist).rotate(mirror.rotation.T)


def camera_state_after(camera_state: CameraState, time_s: float) -> CameraState:
    """Camera state at another time, every pose moved by its twist."""
    objects = (
        replace(
            dynamic_object,
            world_from_object=_integrate_pose(
                dynamic_object.world_from_object, dynamic_object.twist, time_s
            ),
        )
        for dynamic_object in camera_state.objects
    )
    pose = _integrate_pose(camera_state.world_from_mirror, camera_state.twist, time_s)
    return replace(camera_state, world_from_mirror=pose, objects=tuple(objects))


def _integrate_pose(pose: Pose, twist: Twist, time_s: float) -> Pose:
    turn = _rotation_from_vector(np.asarray(twist.angular_rad_s) * time_s)
    return Pose(turn @ pose.rotation, pose.translation + np.asarray(twist.linear_m_s) * time_s)


def _rotation_from_vector(vector: Floats) -> Floats:
    """(3, 3) rotation about a vector by its length. Source: Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * across + (1.0 - math.cos(angle)) * across @ across


def time_samples(duration_s: float, count: int) -> Floats:
    """Centres of equal parts of a duration about 0."""
    return ((np.arange(count) + 0.5) / count - 0.5) * duration_s


def average_frames(view: View, camera_state: CameraState, duration_s: float, count: int) -> Floats:
    """Mean light of sharp frames of a moving robot."""
    frames = (
        view.render_linear(camera_state_after(camera_state, t))
        for t in time_samples(duration_s, count)
    )
    return sum((frame.astype(np.float64) for frame in frames), start=np.array(0.0)) / count


def rmse(one: Floats, other: Floats) -> float:
    """RMS difference of two linear images, in encoded grey levels."""
    difference = 255.0 * (srgb_from_linear(one) - srgb_from_linear(other))
    return float(np.sqrt(np.square(difference).mean()))
