"""Fog on samples: native against float64, each sample by its own distance."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import Threshold
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import TracedFrame, TraceRequest
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, FogMedium, Shutter
from catoptra_server.world.world_description import Box, DirectionalLight, Item, Material, World
from helpers.effect_measurement import make_effect
from helpers.image_comparison import grey_levels
from helpers.long_cases import quick_cases
from helpers.motion_reference import (
    START_POSES,
    crossing_object,
    driving_camera_state,
    load_world_setup,
)
from helpers.trace_engines import ENGINES, open_engine, open_renderer
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_plan, make_test_world

CAMERA = make_omni_camera(width_px=160)
GREY = Material((0.3, 0.4, 0.2))
CAMERA_ABOVE = CameraState(Pose.from_rpy((0.0, 0.0, 0.8)))
FOG = FogMedium(0.2, (0.5, 0.55, 0.6))
START = START_POSES["four_legged_2006"]
STATE = driving_camera_state(START, 0.5, 30.0, crossing_object(START))


def trace(engine: EngineName, state: CameraState, *, is_linear: bool = True) -> TracedFrame:
    world = load_world_setup("four_legged_2006").world
    with open_engine(engine, world, scene=load_world_setup("four_legged_2006").scene) as opened:
        rays = opened.prepare(omni_ray_table(CAMERA, make_plan(CAMERA, samples=2)))
        frame = rays.render(
            state, TraceRequest(is_linear=is_linear, thresholds={"Fog": Threshold(0.5)})
        )
        rays.close()
    return frame


@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("density_per_m", [0.01, 0.2, 5.0, 100.0])
def test_fog_when_native_is_that_of_the_reference(density_per_m: float, has_shadows: bool) -> None:
    fog = replace(FOG, density_per_m=density_per_m)
    state = replace(STATE, fog=fog, has_shadows=has_shadows)
    native, reference = (grey_levels(trace(engine, state).image) for engine in ENGINES)
    difference = np.abs(native - reference).max(axis=-1)
    # An edge may meet another sample in float32.
    assert (difference > 0.1).mean() < 0.002


@pytest.mark.parametrize("engine", ENGINES)
def test_change_by_fog_is_the_largest_difference_from_clear_air(engine: EngineName) -> None:
    foggy, clear = trace(engine, replace(STATE, fog=FOG)), trace(engine, STATE)
    difference = np.abs(grey_levels(foggy.image) - grey_levels(clear.image)).max()
    assert foggy.changes["Fog"].largest == pytest.approx(difference, abs=0.02)


def test_fog_of_each_sample_is_mixed_before_the_mean() -> None:
    state = replace(STATE, fog=FOG)
    world = load_world_setup("four_legged_2006").world
    with open_engine("kernel", world, scene=load_world_setup("four_legged_2006").scene) as engine:
        plan = make_plan(CAMERA, samples=2)
        fine = make_omni_camera(width_px=320)
        rays = engine.prepare(omni_ray_table(CAMERA, plan))
        samples = engine.prepare(omni_ray_table(fine, make_plan(fine, samples=1)))
        mean = samples.render_linear(state).astype(np.float64)
        mean = mean.reshape(160, 2, 160, 2, 3).mean(axis=(1, 3))
        np.testing.assert_allclose(rays.render_linear(state), mean, atol=2e-3)
        rays.close()
        samples.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_background_in_fog_is_the_airlight_and_beside_the_mirror_black(engine: EngineName) -> None:
    with open_engine(engine, World("empty", (), background=(0.1, 0.2, 0.3))) as opened:
        rays = opened.prepare(omni_ray_table(CAMERA, make_plan(CAMERA, samples=2)))
        light = rays.render_linear(replace(CAMERA_STATE, fog=FOG))
        rays.close()
    np.testing.assert_allclose(light[80, 40], FOG.airlight, rtol=1e-6)
    np.testing.assert_array_equal(light[0, 0], 0.0)


def test_fog_of_a_moving_frame_without_motion_is_that_of_a_sharp_one() -> None:
    still = CameraState(START, fog=FOG)
    sharp = trace("kernel", still).image
    for shutter in (Shutter(0.03, 0.0, 9.0), Shutter(0.0, 0.03, 9.0)):
        moving = trace("kernel", replace(still, shutter=shutter)).image
        # Levels of textures are chosen for other blocks of rays: a tenth of a grey level.
        np.testing.assert_allclose(moving, sharp, atol=5e-4)


@pytest.mark.parametrize("engine", ENGINES)
def test_fog_of_a_view_is_measured_with_and_without_image_effects(engine: EngineName) -> None:
    state = replace(CAMERA_STATE, fog=FOG)
    with open_renderer(engine, make_test_world()) as renderer:
        view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=2))
        alone = view.render(state, (), {"Fog": Threshold(0.5)}).changes["Fog"].largest
        with_effect = (
            view.render(state, (make_effect("Vignetting"),), {"Fog": Threshold(0.5)})
            .changes["Fog"]
            .largest
        )
        view.close()
    assert alone > 1.0
    assert with_effect == pytest.approx(alone, abs=0.02)


def make_plain_floor() -> World:
    """A floor of one colour under directional light, and a wall: tiles of one facet each."""
    floor = Item("floor", Box((40.0, 40.0, 0.2)), Pose.from_rpy((0.0, 0.0, -0.1)), GREY)
    wall = Item("wall", Box((0.2, 9.0, 3.0)), Pose.from_rpy((4.0, 0.0, 1.5)), GREY)
    sun = DirectionalLight((-0.3, 0.2, -1.0), (0.6, 0.6, 0.6))
    return World("plain floor", (floor, wall), lights=(sun,), background=(0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("samples", "airlight", "shutter"),
    quick_cases(
        product(
            (1, 2, 3),
            ((0.5, 0.55, 0.6), (0.0, 2.0, 0.9)),
            (None, Shutter(0.03, 0.0, 9.0), Shutter(0.0, 0.03, 9.0)),
        ),
        # Each number of samples, air and shutter, and each pair of air and shutter.
        *(0, 4, 7, 11, 14, 15),
    ),
)
def test_fog_of_tiles_of_one_facet_is_the_mean_of_their_samples(
    samples: int, airlight: tuple[float, float, float], shutter: Shutter | None
) -> None:
    state = replace(CAMERA_ABOVE, fog=FogMedium(0.2, airlight), shutter=shutter)
    request = TraceRequest(thresholds={"Fog": Threshold(0.5)})
    linear_request = replace(request, is_linear=True)
    encoded, linear, changes = [], [], []
    for name in ENGINES:
        with open_engine(name, make_plain_floor()) as engine:
            rays = engine.prepare(omni_ray_table(CAMERA, make_plan(CAMERA, samples=samples)))
            frame = rays.render(state, request)
            encoded.append(frame.image.astype(int))
            changes.append(frame.changes["Fog"].largest)
            linear.append(rays.render(state, linear_request).image)
            rays.close()
    # A sample at an outline may meet another facet in float32.
    assert (np.abs(np.subtract(*linear)).max(axis=-1) > 1e-5).mean() < 1e-3
    assert (np.abs(np.subtract(*encoded)) > 1).mean() < 1e-3
    assert changes[0] == pytest.approx(changes[1], abs=0.02)
