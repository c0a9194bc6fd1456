"""Motion blur and rolling shutter against 64 sharp frames of a moving robot.

Frames of an exposure of 1/30 s, averaged in linear light, and rows of frames at their times. Images
have as many time samples as the criteria's bounds call for, as in the server. Rows are compared at
6 x 6 samples: lines thinner than a pixel differ from frame to frame by the samples that hit them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.startup import StartupConfig
from catoptra_server.effects import Effect, EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import apply_scene_effects, plan_effects
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import View
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Twist
from helpers.long_cases import quick_cases
from helpers.motion_reference import (
    START_POSES,
    average_frames,
    camera_state_after,
    crossing_object,
    driving_camera_state,
    load_world_setup,
    rmse,
)
from helpers.worlds import make_omni_camera, make_plan

CAMERA = make_omni_camera(width_px=200)
PLAN = make_plan(CAMERA, samples=3)
T_S = 1.0 / 30.0
FRAMES = 64


@cache
def load_setup(world: str) -> StartupConfig:
    return load_world_setup(world)


def make_trace(world: str) -> TraceRenderer:
    return TraceRenderer(load_setup(world).scene, load_setup(world).world, threads=2)


def make_raster(world: str, device: GlDevice) -> RasterRenderer:
    return RasterRenderer(load_setup(world).scene, load_setup(world).world, device=device)


def driving_state(start: Pose) -> CameraState:
    return driving_camera_state(start, 0.5, 0.0)


def turning_state(start: Pose) -> CameraState:
    return driving_camera_state(start, 0.0, 60.0)


def state_with_object(start: Pose) -> CameraState:
    return driving_camera_state(start, 0.5, 60.0, crossing_object(start))


def spinning_state(start: Pose) -> CameraState:
    return driving_camera_state(start, 0.5, 180.0)


def pitching_state(start: Pose) -> CameraState:
    """A robot on a slope that only tips over, at 1 rad/s about an axle 0.6 m below."""
    tilted = start @ Pose.from_rpy((0.0, 0.0, 0.0), (0.1, 0.2, 0.0))
    across, down = tilted.rotation[:, 1], 0.6 * tilted.rotation[:, 2]
    return CameraState(
        tilted, twist=Twist((*np.cross(across, -down).tolist(),), (*across.tolist(),))
    )


Moving = Callable[[Pose], CameraState]


@cache
def summarizer(world: str) -> SceneSummarizer:
    return SceneSummarizer(load_setup(world).scene, load_setup(world).world)


def with_scene_effects(world: str, camera_state: CameraState, *effects: Effect) -> CameraState:
    """Apply scene effects as the server does."""
    effect_settings = EffectSettings(
        tuple(EffectSetting(effect, EffectMode.ALWAYS) for effect in effects)
    )
    summary = summarizer(world).summarize(camera_state, CAMERA)
    return apply_scene_effects(camera_state, plan_effects(effect_settings, summary, CAMERA))


def assert_like_frames(world: str, view: View, camera_state: CameraState) -> None:
    mean = average_frames(view, camera_state, T_S, FRAMES)
    sharp = view.render_linear(camera_state).astype(np.float64)
    long = with_scene_effects(world, camera_state, MotionBlur(T_S))
    blurred = view.render_linear(long).astype(np.float64)
    assert rmse(blurred, mean) <= 1.0
    assert rmse(blurred, mean) < 0.5 * rmse(sharp, mean)


# With the instants that the bounds call for; each motion is compared with as many as the kernel
# takes in trace/test_engine_shutter.py.
@pytest.mark.parametrize(
    ("world", "moving"),
    quick_cases(
        product(
            ("corridor", "four_legged_2006"),
            (driving_state, turning_state, state_with_object, spinning_state, pitching_state),
        ),
        3,
        4,
        7,
    ),
)
def test_blur_when_traced_equals_the_mean_of_64_frames(world: str, moving: Moving) -> None:
    renderer = make_trace(world)
    assert_like_frames(world, renderer.prepare(CAMERA, PLAN), moving(START_POSES[world]))
    renderer.close()


def test_blur_when_just_needed_changes_the_image() -> None:
    renderer, start = make_trace("corridor"), START_POSES["corridor"]
    view = renderer.prepare(CAMERA, PLAN)
    camera_state = driving_camera_state(start, 0.0, 10.0)
    staged_for = with_scene_effects("corridor", camera_state, MotionBlur(T_S))
    assert staged_for.shutter is not None
    assert staged_for.shutter.num_time_samples == 2
    assert rmse(view.render_linear(staged_for), view.render_linear(camera_state)) > 0.02
    renderer.close()


@pytest.mark.parametrize(
    ("world", "moving"), [("corridor", state_with_object), ("four_legged_2006", turning_state)]
)
def test_blur_when_rastered_equals_the_mean_of_64_frames(
    device: GlDevice, world: str, moving: Moving
) -> None:
    renderer = make_raster(world, device)
    view = renderer.prepare(CAMERA, PLAN)
    assert_like_frames(world, view, moving(START_POSES[world]))
    view.close()


# Of the rows that are read one by one.
ROWS = slice(2, None, 5)


def rows_of_frames(view: View, camera_state: CameraState) -> Floats:
    """ROWS of the image whose every row is that of the frame at the row's own time."""
    rows = range(CAMERA.height_px)[ROWS]
    times_s = T_S * ((np.arange(CAMERA.height_px) + 0.5) / CAMERA.height_px - 0.5)
    frames = [
        view.render_linear(camera_state_after(camera_state, float(times_s[row])))[row]
        for row in rows
    ]
    return np.stack(frames).astype(np.float64)


@pytest.mark.parametrize(
    ("world", "moving"), [("corridor", pitching_state), ("four_legged_2006", turning_state)]
)
def test_rows_when_read_one_by_one_are_those_of_frames(world: str, moving: Moving) -> None:
    renderer, camera_state = make_trace(world), moving(START_POSES[world])
    view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=6))
    expected = rows_of_frames(view, camera_state)
    sharp = view.render_linear(camera_state)[ROWS].astype(np.float64)
    rolled = view.render_linear(with_scene_effects(world, camera_state, RollingShutter(T_S)))[ROWS]
    assert rmse(rolled.astype(np.float64), expected) <= 1.0
    assert rmse(rolled.astype(np.float64), expected) < 0.6 * rmse(sharp, expected)
    renderer.close()
