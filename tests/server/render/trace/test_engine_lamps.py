"""Worlds that lamps light, in the kernel: shadows that nobody sees, and bright exposures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.effects import Threshold
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import TraceRequest
from catoptra_server.world.objects import CameraState, Shutter
from helpers.image_comparison import grey_levels
from helpers.lit_worlds import TUNNEL_CAMERA, make_hall, make_tunnel
from helpers.motion_reference import camera_state_after, driving_camera_state, time_samples
from helpers.trace_kernels import open_kernel
from helpers.worlds import make_omni_camera, make_plan, write_fine_texture

CAMERA = make_omni_camera(width_px=240)
TABLE = omni_ray_table(CAMERA, make_plan(CAMERA, samples=2))
STATE = CameraState(TUNNEL_CAMERA, has_shadows=True)
EXPOSURE_S = 1.0 / 30.0


@pytest.mark.parametrize("is_textured", [False, True])
@pytest.mark.parametrize("intensity", [0.012, 0.1, 1.0])
@pytest.mark.parametrize("threshold", [Threshold(0.5), Threshold(2.0, (0.3, 3.0))])
def test_shadows_when_lamps_are_dim_differ_from_all_by_the_threshold_at_most(
    tmp_path: Path, threshold: Threshold, intensity: float, is_textured: bool
) -> None:
    texture = write_fine_texture(tmp_path / "fine.png") if is_textured else None
    request = TraceRequest(is_linear=True, thresholds={"Shadows": threshold})
    with open_kernel(make_tunnel(intensity, texture=texture)) as engine:
        rays = engine.prepare(TABLE)
        all_rays, frame = rays.render_linear(STATE), rays.render(STATE, request)
        lit = rays.render_linear(CameraState(TUNNEL_CAMERA))
    # Half of the threshold is for lamps that are skipped, and counts as changed.
    largest = find_changes(all_rays, frame.image, threshold.gains).max()
    assert largest <= 0.5 * threshold.max_change
    assert (
        frame.changes["Shadows"].largest
        >= find_changes(lit, all_rays, threshold.gains).max() - 0.02
    )


def test_shadows_that_nobody_sees_are_left_out_but_for_those_that_need_no_ray() -> None:
    # A hundredth of a grey level each; light maps know some points to be hidden.
    request = TraceRequest(is_linear=True, thresholds={"Shadows": Threshold(0.5)})
    with open_kernel(make_tunnel(1e-3)) as engine:
        rays = engine.prepare(TABLE)
        lit = rays.render_linear(CameraState(TUNNEL_CAMERA))
        shadowed, thresholded = rays.render_linear(STATE), rays.render(STATE, request).image
    lost, kept = (image != lit for image in (shadowed, thresholded))
    assert kept.sum() < 0.5 * lost.sum()


def test_shadows_of_dim_lamps_when_threads_differ_have_the_same_bytes() -> None:
    request = TraceRequest(is_linear=True, thresholds={"Shadows": Threshold(0.5)})
    frames = []
    for threads in (1, 3):
        with open_kernel(make_tunnel(0.1), threads=threads) as engine:
            frames.append(engine.prepare(TABLE).render(STATE, request).image)
    np.testing.assert_array_equal(frames[0], frames[1])


def test_blur_of_walls_that_lamps_light_evenly_takes_few_rays() -> None:
    moving = driving_camera_state(TUNNEL_CAMERA, 0.5, 30.0)
    state = replace(moving, shutter=Shutter(EXPOSURE_S, 0.0, 64.0))
    thresholds = {"MotionBlur": Threshold(0.5)}
    with open_kernel(make_hall()) as engine:
        rays = engine.prepare(TABLE)
        rays.render(state, TraceRequest(is_linear=True, thresholds=thresholds))
        counts = rays.last_counts
    # Of all tiles: 80 where two more instants of all facets are drawn, 69 of those alone that need
    # it, 63 without those that the sharp frame's samples tell.
    assert counts.num_blur_rays < 66 * counts.num_tiles


@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("is_textured", [False, True])
def test_blur_of_a_hall_brighter_than_white_is_the_mean_of_64_frames(
    tmp_path: Path, is_textured: bool, has_shadows: bool
) -> None:
    texture = write_fine_texture(tmp_path / "fine.png") if is_textured else None
    state = replace(driving_camera_state(TUNNEL_CAMERA, 0.5, 30.0), has_shadows=has_shadows)
    # Half of the light reaches the picture: what is brighter than white shows there.
    gains = (0.5, 0.5)
    thresholds = {"MotionBlur": Threshold(0.5, gains)}
    with open_kernel(make_hall(texture)) as engine:
        rays = engine.prepare(TABLE)
        exposed = replace(state, shutter=Shutter(EXPOSURE_S, 0.0, 64.0))
        blurred = rays.render(exposed, TraceRequest(is_linear=True, thresholds=thresholds)).image
        frames = [
            rays.render_linear(camera_state_after(state, float(t))).astype(np.float64)
            for t in time_samples(EXPOSURE_S, 64)
        ]
    mean = np.mean(frames, axis=0)
    assert mean.max() > 1.5
    difference = np.abs(grey_levels(0.5 * blurred) - grey_levels(0.5 * mean)).max(axis=-1)
    # Edges are 640 / 240 times as frequent as at 640 px.
    assert (difference > 2.0).mean() < 0.01 * 640 / CAMERA.width_px
    assert (difference > 8.0).mean() < 0.001 * 640 / CAMERA.width_px
