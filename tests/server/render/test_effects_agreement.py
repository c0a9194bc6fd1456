"""Both renderers show the same image after the same effects; flat fields have EMVA 1288's noise.

The tolerance of images is one grey level beside the renderers' difference without effects: at
edges, see test_agreement.py. Photon transfer is measured as in a laboratory: pairs of frames of an
evenly lit world, the mean of each level against the variance of the difference of a pair.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import ImageEffect
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import View
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import FogMedium, NoiseSeed
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, World, srgb_from_linear
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.effect_measurement import CAMERA, make_effect
from helpers.image_changers import open_changer_or_skip
from helpers.image_comparison import level_differences, mask_away_from_edges
from helpers.opengl import make_raster
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)

SENSOR = tuple(
    make_effect(name, changes)
    for name, changes in (
        ("Vignetting", {}),
        ("AutoExposure", {}),
        ("FixedPattern", {}),
        ("ShotNoise", {}),
        ("ReadNoise", {}),
        ("Quantisation", {"adc_bits": 12}),
        ("WhiteBalance", {"red_gain": 1.3, "blue_gain": 0.8}),
        ("Response", {"knee": 0.3, "white": 2.0}),
    )
)
FULL_WELL, BITS = 18000.0, 12
STEPS = 2**BITS - 1
GAIN = STEPS / FULL_WELL  # EMVA's K, codes an electron
FLAT = make_omni_camera(width_px=160)
CENTRE = (slice(40, 120), slice(40, 120))


@pytest.mark.parametrize("is_native", [False, True])
def test_renderers_with_a_simulated_sensor_agree(device: GlDevice, is_native: bool) -> None:
    world, plan = make_test_world(), make_plan(CAMERA, samples=2)
    scene = build_scene(world)
    trace = TraceRenderer(scene, world, threads=2)
    stack = ExitStack()
    changer = open_changer_or_skip(stack) if is_native else None
    raster = RasterRenderer(scene, world, device=device, image_changer=changer)
    calm = trace.prepare(CAMERA, plan).render(CAMERA_STATE).rgb
    view = raster.prepare(CAMERA, plan)
    trace_image = trace.prepare(CAMERA, plan).render(CAMERA_STATE, SENSOR).rgb
    difference = level_differences(view.render(CAMERA_STATE, SENSOR).rgb, trace_image)
    smooth = mask_away_from_edges(calm)
    assert smooth.mean() > 0.5
    # One grey level: of the converter's codes either neighbour, rounded.
    assert (difference[smooth] > 1).mean() < 2e-3
    assert (difference > 2).mean() < 0.05
    view.close()
    stack.close()
    trace.close()


@pytest.mark.parametrize("density_per_m", [0.05, 0.6])
def test_renderers_with_fog_agree(device: GlDevice, density_per_m: float) -> None:
    # By range, not by face: over the faces' borders too, with robots, and none of it by samples.
    world, camera = make_test_world(), make_omni_camera(width_px=300)
    camera_state, plan = (
        replace(CAMERA_STATE, objects=TWO_ROBOTS),
        make_plan(camera, face_size_px=640),
    )
    in_fog = replace(camera_state, fog=FogMedium(density_per_m, (0.5, 0.5, 0.8)))
    scene = build_scene(world)
    trace = TraceRenderer(scene, world, threads=2)
    view = RasterRenderer(scene, world, device=device).prepare(camera, plan)
    calm = trace.prepare(camera, plan).render(camera_state).rgb
    foggy = trace.prepare(camera, plan).render(in_fog).rgb
    difference = level_differences(view.render(in_fog).rgb, foggy)
    smooth = mask_away_from_edges(calm)
    assert (level_differences(calm, foggy) > 8).mean() > 0.5
    assert (difference[smooth] > 2).mean() < 1e-3
    assert (difference > 2).mean() < 0.05
    view.close()
    trace.close()


@pytest.mark.parametrize("background", [0.5, 0.45])
@pytest.mark.parametrize("step", range(-5, 0))
def test_fog_in_a_rendered_scene_stays_within_its_bound(background: float, step: int) -> None:
    black = Material((0.0, 0.0, 0.0), unlit=True)
    far = Item("far", Box((0.2, 3.0, 1.0)), Pose.from_rpy((-8.0, 0.5, -0.5)), black)
    world = World(
        "room",
        (*make_test_world().items, far),
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
        background=(background,) * 3,
    )
    trace = TraceRenderer(build_scene(world), world, threads=2)
    view = trace.prepare(CAMERA, make_plan(CAMERA))
    fog = Fog(10.0**step, 0.5, 0.5, 0.5)
    camera_state = replace(CAMERA_STATE, objects=TWO_ROBOTS)
    bound = fog.bound(
        SceneSummarizer(build_scene(world), world).summarize(camera_state, CAMERA), CAMERA
    ).value
    in_fog = fog.apply_to_scene(camera_state, 0.0)
    clear, foggy = (view.render_linear(state) for state in (camera_state, in_fog))
    trace.close()
    change = 255.0 * np.abs(srgb_from_linear(foggy) - srgb_from_linear(clear)).max()
    assert change <= bound + 1e-3
    assert change > 0.25 if bound > 0.5 else change <= 0.5


def prepare_trace(world: World, device: GlDevice) -> View:
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    return renderer.prepare(FLAT, make_plan(FLAT))


def prepare_raster(world: World, device: GlDevice) -> View:
    renderer = make_raster(device, world)
    return renderer.prepare(FLAT, make_plan(FLAT))


Prepare = Callable[[World, GlDevice], View]


def measure_codes(view: View, chain: tuple[ImageEffect, ...], index: int) -> Floats:
    """Codes at the centre of a flat field, from one exposure."""
    camera_state = replace(CAMERA_STATE, noise_seed=NoiseSeed((1, 2), index))
    return STEPS * view.render_linear(camera_state, chain)[CENTRE].astype(np.float64)


def make_flat_field(level: float) -> World:
    return World("flat", (), background=(level, level, level))


@pytest.mark.parametrize("prepare", [prepare_trace, prepare_raster])
def test_photon_transfer_when_measured_has_the_gain_and_the_dark_noise_of_the_sensor(
    device: GlDevice, prepare: Prepare
) -> None:
    chain = (
        make_effect("FixedPattern", {"prnu": 0.01, "dsnu_e": 6.0}),
        make_effect("ShotNoise"),
        make_effect("ReadNoise"),
        make_effect("Quantisation", {"adc_bits": BITS}),
    )
    means, variances = [], []
    for level in (0.0, 0.1, 0.3, 0.5, 0.7):
        view = prepare(make_flat_field(level), device)
        first, second = measure_codes(view, chain, 1), measure_codes(view, chain, 2)
        view.close()
        means.append(0.5 * (first + second).mean())
        variances.append(0.5 * (first - second).var())
    slope, dark = np.polyfit(means, variances, 1)
    # 19 200 differences a level: a variance is known to 1 %.
    assert slope == pytest.approx(GAIN, rel=0.03)
    assert variances[0] == pytest.approx((GAIN * 13.0) ** 2 + 1.0 / 12.0, rel=0.1)
    assert dark == pytest.approx((GAIN * 13.0) ** 2 + 1.0 / 12.0, abs=0.03 * variances[-1])


@pytest.mark.parametrize("prepare", [prepare_trace, prepare_raster])
def test_nonuniformity_when_frames_are_averaged_is_that_of_the_sensor(
    device: GlDevice, prepare: Prepare
) -> None:
    pattern = make_effect("FixedPattern", {"prnu": 0.02, "dsnu_e": 30.0})
    noise = make_effect("ShotNoise", {"full_well_e": FULL_WELL})
    spreads = []
    for level in (0.0, 0.5):
        view = prepare(make_flat_field(level), device)
        exposed = [measure_codes(view, (pattern, noise), index) for index in range(16)]
        spreads.append(np.mean(exposed, axis=0).std())
        view.close()
    dsnu_e = spreads[0] / GAIN
    temporal = GAIN**2 * 0.5 * FULL_WELL / 16
    prnu = np.sqrt(spreads[1] ** 2 - temporal - spreads[0] ** 2) / (0.5 * STEPS)
    # In the dark half of the wells would be negative: they have no shot noise.
    assert dsnu_e == pytest.approx(30.0, rel=0.03)
    assert prnu == pytest.approx(0.02, rel=0.03)
