"""Motion blur and rolling shutter against sharp frames of a robot that really moves.

64 frames of an exposure of 1/30 s, averaged in linear light, and rows of frames at their times. One
sharp picture knows no more of lines thinner than a pixel than its samples say: the field has white
ones on dark carpet all around, so it is held to 1 grey level beside the carpet, and on the whole to
less than 2.5. A row of a frame cannot be that of another one at edges either: smooth places are
held to 1 grey level.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np
import pytest

from catoptra_protocol.optics.camera import pixel_centres
from catoptra_server.effects.motion_blur import MotionBlur
from catoptra_server.effects.rolling_shutter import RollingShutter, row_times
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.context import GlDevice
from catoptra_server.render.renderer import Exposure, OmniView
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.setup import Setup
from helpers.motion import (
    STARTS,
    after,
    crossing,
    driving,
    mean_of_frames,
    rmse,
    world_setup,
)
from helpers.opengl import device_or_skip
from helpers.pictures import away_from_edges
from helpers.worlds import omni_camera, raster_plan

CAMERA = omni_camera(width_px=240)
SAMPLES = 3
T_S = 1.0 / 30.0
FRAMES = 64
# Image radii of the carpet, seen from the start.
_CARPET_PX = 78.0


@pytest.fixture(scope="module")
def device() -> Iterator[GlDevice]:
    device = device_or_skip()
    yield device
    device.close()


@cache
def setup(world: str) -> Setup:
    return world_setup(world)


def traced(world: str) -> OmniView:
    made = setup(world)
    renderer = TraceRenderer(made.scene, made.world, threads=2)
    return renderer.prepare(CAMERA, raster_plan(CAMERA, samples=SAMPLES))


def rastered(world: str, device: GlDevice) -> OmniView:
    made = setup(world)
    renderer = RasterRenderer(made.scene, made.world, device=device)
    return renderer.prepare(CAMERA, raster_plan(CAMERA, samples=SAMPLES))


def drive(world: str) -> Exposure:
    return driving(STARTS[world], 0.5, 0.0)


def turn(world: str) -> Exposure:
    return driving(STARTS[world], 0.0, 60.0)


def both(world: str) -> Exposure:
    return driving(STARTS[world], 0.5, 60.0)


def with_body(world: str) -> Exposure:
    return driving(STARTS[world], 0.5, 60.0, crossing(STARTS[world]))


def spin(world: str) -> Exposure:
    return driving(STARTS[world], 0.5, 180.0)


Moving = Callable[[str], Exposure]


def assert_like_frames(view: OmniView, world: str, moving: Moving) -> None:
    exposure = moving(world)
    mean = mean_of_frames(view, exposure, T_S, FRAMES)
    sharp = view.draw_linear(exposure).astype(np.float64)
    blurred = view.draw_linear(exposure, (MotionBlur(T_S),)).astype(np.float64)
    assert rmse(blurred, mean) < rmse(sharp, mean)
    if world == "corridor":
        assert rmse(blurred, mean) <= 1.0
        return
    beside = np.linalg.norm(pixel_centres(CAMERA)[..., 0, :] - CAMERA.centre_px, axis=-1)
    beside_carpet = beside > _CARPET_PX
    assert rmse(blurred[beside_carpet], mean[beside_carpet]) <= 1.0
    assert rmse(blurred, mean) <= 2.5


CASES = [
    *(("corridor", moving) for moving in (drive, turn, both, with_body, spin)),
    *(("four_legged_2006", moving) for moving in (drive, turn, both, with_body)),
]


@pytest.mark.parametrize(("world", "moving"), CASES)
def test_blur_when_traced_equals_the_mean_of_64_frames(world: str, moving: Moving) -> None:
    view = traced(world)
    assert_like_frames(view, world, moving)
    view.close()


@pytest.mark.parametrize(
    ("world", "moving"), [("corridor", turn), ("corridor", with_body), ("four_legged_2006", both)]
)
def test_blur_when_rastered_equals_the_mean_of_64_frames(
    device: GlDevice, world: str, moving: Moving
) -> None:
    view = rastered(world, device)
    assert_like_frames(view, world, moving)
    view.close()


def test_body_when_it_crosses_fast_is_blurred_over_what_is_behind_it() -> None:
    world, view = "four_legged_2006", traced("four_legged_2006")
    exposure = driving(STARTS[world], 0.0, 0.0, crossing(STARTS[world], 2.0))
    mean = mean_of_frames(view, exposure, T_S, FRAMES)
    sharp = view.draw_linear(exposure).astype(np.float64)
    blurred = view.draw_linear(exposure, (MotionBlur(T_S),)).astype(np.float64)
    where = (np.abs(mean - sharp) > 1e-3).any(axis=-1)
    assert where.sum() > 100
    assert rmse(blurred[where], mean[where]) < 0.6 * rmse(sharp[where], mean[where])
    view.close()


@pytest.mark.parametrize(
    ("world", "moving", "share"),
    [("corridor", turn, 0.4), ("corridor", both, 0.4), ("four_legged_2006", turn, 0.9)],
)
def test_rows_when_read_one_by_one_are_those_of_frames(
    world: str, moving: Moving, share: float
) -> None:
    view, exposure, rows = traced(world), moving(world), range(12, 240, 6)
    times_s = row_times(CAMERA, T_S)
    frames = [view.draw_linear(after(exposure, times_s[row]))[row] for row in rows]
    expected = np.stack(frames).astype(np.float64)
    sharp = view.draw_linear(exposure)[rows].astype(np.float64)
    rolled = view.draw_linear(exposure, (RollingShutter(T_S),))[rows].astype(np.float64)
    smooth = [away_from_edges(view.draw(after(exposure, times_s[row])).rgb)[row] for row in rows]
    assert np.mean(smooth) > 0.5
    assert rmse(rolled[np.stack(smooth)], expected[np.stack(smooth)]) <= 1.0
    # An edge of one frame is made of other samples than that of the next.
    assert rmse(rolled, expected) < share * rmse(sharp, expected)
    view.close()
