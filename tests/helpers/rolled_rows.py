"""Rows of a rolling shutter beside means of sharp frames about their own times."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import Threshold
from catoptra_server.effects.kernels.grey_levels import valid_pixels
from catoptra_server.render.trace.kernel.kernel_engine import KernelRays
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import TraceRequest
from catoptra_server.world.objects import CameraState, Shutter
from helpers.finished_pictures import real_camera_in
from helpers.image_comparison import grey_levels
from helpers.lit_worlds import TUNNEL_CAMERA, make_hall, make_tunnel
from helpers.motion_reference import camera_state_after, driving_camera_state
from helpers.trace_kernels import open_kernel
from helpers.worlds import make_plan

READOUT_S = 1.0 / 30.0
SHUTTERS = {
    "rolling": Shutter(0.0, READOUT_S, 64.0),
    "blur": Shutter(1.0 / 60.0, 0.0, 64.0),
    "rolling and blur": Shutter(1.0 / 60.0, READOUT_S, 64.0),
}
MOTIONS = {
    "0.5 m/s, 0.5 rad/s": (0.5, 28.6),
    "turn of 0.5 rad/s": (0.0, 28.6),
    "2 m/s": (2.0, 0.0),
    "turn of 2 rad/s": (0.2, 114.0),
}
MADE = {"tunnel": make_tunnel, "hall": make_hall}
WORLDS = ("four_legged_2006", "corridor", "rescue", "warehouse", *MADE)
# Of the readout: 64 in the exposure.
_STEPS = 128
# What a frame decides on may be left out by the shipped number.
_THRESHOLDS = dict.fromkeys(("MotionBlur", "RollingShutter"), Threshold(1.0))


@contextmanager
def open_moving_rays(
    world: str, camera: OmniCamera, *, samples: int = 2
) -> Iterator[tuple[KernelRays, Pose]]:
    """Rays of a camera in a shipped or made world, and where it starts."""
    setup = real_camera_in("corridor" if world in MADE else world)
    lit = MADE[world]() if world in MADE else setup.world
    pose = TUNNEL_CAMERA
    if lit.starts:
        x_m, y_m = lit.starts[0].location_m[:2]
        pose = Pose.from_rpy((x_m, y_m, -0.6), (0.0, 0.0, lit.starts[0].rotation_rad[2]))
    scene = None if world in MADE else setup.scene
    with open_kernel(lit, scene=scene, threads=2) as engine:
        rays = engine.prepare(omni_ray_table(camera, make_plan(camera, samples=samples)))
        yield rays, pose
        rays.close()


def find_row_differences(
    rays: KernelRays, camera: OmniCamera, state: CameraState, shutter: Shutter
) -> Floats:
    """Largest difference of each of the mirror's pixels in some rows from the mean of 64 sharp
    frames about the row's time, or from the one frame of that time, grey levels.

    Args:
        rays: Rays of the camera.
        camera: The camera; the number of its rows is a multiple of 15.
        state: State at the middle of the readout.
        shutter: Shutter of the compared picture.
    """
    request = TraceRequest(is_linear=True, thresholds=_THRESHOLDS)
    image = rays.render(replace(state, shutter=shutter), request).image
    # Rows whose times are whole steps: each frame serves all rows that are exposed during it.
    rows = np.arange(7, camera.height_px, 15)
    step_s = READOUT_S / _STEPS
    readout = _STEPS * shutter.readout_s / READOUT_S
    centres = ((rows + 0.5) / camera.height_px - 0.5) * readout
    mean = np.zeros((len(rows), camera.width_px, 3))
    if not shutter.exposure_s:
        for i, centre in enumerate(centres):
            mean[i] = rays.render_linear(camera_state_after(state, float(centre) * step_s))[rows[i]]
    half = 0.5 * shutter.exposure_s / step_s
    for step in np.arange(-0.5 * _STEPS - half, 0.5 * _STEPS + half) + 0.5 if half else ():
        is_exposed = np.abs(step - centres) < half
        frame = rays.render_linear(camera_state_after(state, float(step) * step_s))
        # Summed before the well clips.
        mean[is_exposed] += frame[rows[is_exposed]] / (2.0 * half)
    differences: Floats = np.abs(grey_levels(image[rows]) - grey_levels(mean)).max(axis=-1)
    return differences[valid_pixels(camera)[rows]]


def moving_state(pose: Pose, motion: str, *, has_shadows: bool = True) -> CameraState:
    """State of a robot in one of MOTIONS."""
    return replace(driving_camera_state(pose, *MOTIONS[motion]), has_shadows=has_shadows)
