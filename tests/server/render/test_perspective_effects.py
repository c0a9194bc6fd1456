"""Effects of a perspective camera: both renderers agree, and the physics is that of its own lens.

Mirror and lens share effects, bounds and passes; these tests have what differs: the angle at the
lens, the image scale, the plane of focus, and the axis ahead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import (
    EFFECT_TYPES,
    CaptureContext,
    Effect,
    EffectMode,
    EffectSetting,
    EffectSettings,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectPlan, apply_scene_effects, plan_effects
from catoptra_server.effects.kernels.light_sources import find_light_sources
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import View
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState, NoiseSeed
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Item,
    Material,
    PointLight,
    Twist,
    World,
    srgb_from_linear,
)
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.effect_measurement import make_any_effect
from helpers.image_comparison import level_differences, mask_away_from_edges
from helpers.opengl import make_raster
from helpers.renderers import RendererFactory
from helpers.worlds import CAMERA_STATE, make_test_world

CAMERA = PerspectiveCamera(160, 120, math.radians(90.0))
# Gloss is of trace alone; the others are of worlds with a sky and baked light.
ELSEWHERE = ("Gloss", "BakedLight", "SkyRadiance")
NAMES = [
    kind.name
    for kind in EFFECT_TYPES.values()
    if not kind.needs_mirror and kind.name not in ELSEWHERE
]
# So strong that pixels change, where the defaults change few or none.
WIDE_OPEN = {"f_number": 1.4, "pixel_pitch_m": 3e-5, "focus_distance_m": 0.4}
STRONG = {
    "Defocus": WIDE_OPEN,
    "DefocusByDepth": WIDE_OPEN,
    "Exposure": {"exposure_s": 1.0 / 15.0},
    "Quantisation": {"adc_bits": 8},
    "Fog": {"density_per_m": 0.3, "blue": 0.8},
    "ChromaticAberration": {"red_magnification": 1.01, "blue_magnification": 0.99},
    "RollingShutter": {"readout_s": 1.0 / 30.0},
    "WhiteBalance": {"red_gain": 1.3, "blue_gain": 0.8},
    "Response": {"knee": 0.3, "white": 2.0},
}
# Ahead and to the right, with a turn.
STATE = replace(
    CAMERA_STATE,
    objects=TWO_ROBOTS,
    noise_seed=NoiseSeed((7, 11), 3),
    twist=Twist((0.3, 0.1, 0.0), (0.0, 0.0, 0.5)),
)
STILL = CameraState(Pose.identity())
WHITE, BLACK = Material((1.0, 1.0, 1.0), unlit=True), Material((0.0, 0.0, 0.0), unlit=True)


def plan_always(
    world: World, camera_state: CameraState, camera: RadialCamera, *effects: Effect
) -> EffectPlan:
    settings = EffectSettings(tuple(EffectSetting(one, EffectMode.ALWAYS) for one in effects))
    summary = SceneSummarizer(build_scene(world), world).summarize(camera_state, camera)
    return plan_effects(settings, summary, camera)


def draw(view: View, camera_state: CameraState, plan: EffectPlan) -> Floats:
    """Linear image with the effects of a plan."""
    staged = apply_scene_effects(camera_state, plan)
    return view.render_linear(staged, plan.image_effects).astype(np.float64)


def find_chain(name: str, strong: Mapping[str, Mapping[str, float]] = STRONG) -> tuple[Effect, ...]:
    """An effect, behind another one where no light of the world calls for it."""
    names = ("Exposure", name) if name == "Blooming" else (name,)
    return tuple(make_any_effect(each, strong.get(each)) for each in names)


def compare_renderers(
    device: GlDevice,
    camera: RadialCamera,
    effects: tuple[Effect, ...],
    *,
    prepare_traced: Callable[[TraceRenderer], View],
    prepare_rastered: Callable[[RasterRenderer], View],
) -> tuple[float, float]:
    """Fractions of pixels, away from edges and of all, that differ by more than 2 grey levels.

    The last effect must change the traced image.
    """
    world = make_test_world()
    plan = plan_always(world, STATE, camera, *effects)
    before = plan_always(world, STATE, camera, *effects[:-1])
    staged = apply_scene_effects(STATE, plan)
    trace = TraceRenderer(build_scene(world), world, threads=2)
    traced_view = prepare_traced(trace)
    calm = traced_view.render(STATE, before.image_effects).rgb
    traced = traced_view.render(staged, plan.image_effects).rgb
    trace.close()
    view = prepare_rastered(make_raster(device, world))
    rastered = view.render(staged, plan.image_effects).rgb
    view.close()
    assert (level_differences(calm, traced) > 0).mean() > 1e-3, "the effect shows"
    differs = level_differences(rastered, traced) > 2
    smooth = mask_away_from_edges(calm) & mask_away_from_edges(traced)
    return float(differs[smooth].mean()), float(differs.mean())


@pytest.mark.parametrize("name", NAMES)
def test_renderers_with_an_effect_agree(device: GlDevice, name: str) -> None:
    smooth, everywhere = compare_renderers(
        device,
        CAMERA,
        find_chain(name),
        prepare_traced=lambda renderer: renderer.prepare_perspective(CAMERA, 2),
        prepare_rastered=lambda renderer: renderer.prepare_perspective(CAMERA, 2),
    )
    assert smooth < 2e-3
    assert everywhere < 0.05


def flat_field(level: float) -> World:
    return World("flat", (), background=(level, level, level))


def test_vignetting_is_the_fourth_power_of_the_cosine_of_each_pixel_s_ray(
    make_renderer: RendererFactory,
) -> None:
    world = flat_field(0.5)
    view = make_renderer(world).prepare_perspective(CAMERA, 1)
    plan = plan_always(world, STILL, CAMERA, make_any_effect("Vignetting"))
    direction, valid = CAMERA.direction_from_pixel(pixel_sample_positions(CAMERA)[:, :, 0])
    assert valid.all()
    expected = 0.5 * direction[..., 0] ** 4
    assert draw(view, STILL, plan)[..., 1] == pytest.approx(expected, rel=1e-3)
    view.close()


@pytest.mark.parametrize("distance_m", [3.0, 5.0])
def test_lamp_ahead_spreads_its_glare_unless_a_wall_hides_it(
    make_renderer: RendererFactory, distance_m: float
) -> None:
    wall = Item("wall", Box((0.1, 40.0, 40.0)), Pose.from_rpy((distance_m, 0.0, 0.0)), WHITE)
    lamp = PointLight((4.0, 0.0, 0.0), (1.6, 0.8, 0.0))
    world = World("lamp", (wall,), lights=(lamp,), background=(0.0, 0.0, 0.0))
    effect = make_any_effect("VeilingGlare", {"index": 0.1})
    plan = plan_always(world, STILL, CAMERA, effect)
    view = make_renderer(world).prepare_perspective(CAMERA, 1)
    dark = draw(view, STILL, plan_always(world, STILL, CAMERA))
    lit = draw(view, STILL, plan)
    view.close()
    ranges = np.full(dark.shape[:2], distance_m, dtype=np.float32)
    sources = find_light_sources(world.lights, CAMERA, STILL, ranges)
    assert len(sources) == (distance_m > 4.0)
    (of_plan,) = plan.image_effects
    expected = of_plan.apply(dark, CAMERA, CaptureContext(sources=sources))
    np.testing.assert_allclose(lit, expected, atol=2e-5)
    # A lit wall of radiance 1 at most is seen behind: the glare of the lamp itself.
    assert (lit - dark)[60, 80, 0] > 0.05 or not sources


def wall_to_the_right(edge_m: float = 0.0) -> World:
    """White wall ahead at 4 m, from an edge to the right."""
    wall = Item("wall", Box((0.1, 8.0, 16.0)), Pose.from_rpy((4.05, 4.0 + edge_m, 0.0)), WHITE)
    return World("wall", (wall,), background=(0.0, 0.0, 0.0))


RATE_RAD_S = 1.0
TURNING = CameraState(Pose.identity(), twist=Twist((0.0, 0.0, 0.0), (0.0, 0.0, RATE_RAD_S)))
DETAILED = PerspectiveCamera(321, 65, math.radians(60.0))


def test_motion_blur_of_a_turn_is_as_wide_as_the_focal_length_says(
    make_renderer: RendererFactory,
) -> None:
    exposure_s = 0.04
    world = wall_to_the_right()
    view = make_renderer(world).prepare_perspective(DETAILED, 4)
    effect = make_any_effect("MotionBlur", {"exposure_s": exposure_s})
    row = draw(view, TURNING, plan_always(world, TURNING, DETAILED, effect))[32, :, 1]
    view.close()
    # A ramp from black to white: its variance as a spread is width^2 / 12.
    spread = np.diff(row)
    u = np.arange(1, len(row))
    mean = (spread * u).sum()
    variance = (spread * (u - mean) ** 2).sum() - 1.0 / 12.0  # of the pixel itself
    width_px = DETAILED.focal_length_px * RATE_RAD_S * exposure_s
    assert width_px > 10.0
    assert math.sqrt(12.0 * variance) == pytest.approx(width_px, rel=0.03)
    assert mean == pytest.approx(0.5 * 321, abs=0.3)


def test_rolling_shutter_of_a_turn_leans_edges_by_the_rows_times(
    make_renderer: RendererFactory,
) -> None:
    readout_s = 0.05
    world = wall_to_the_right()
    view = make_renderer(world).prepare_perspective(DETAILED, 2)
    effect = make_any_effect("RollingShutter", {"readout_s": readout_s})
    image = draw(view, TURNING, plan_always(world, TURNING, DETAILED, effect))[..., 1]
    view.close()
    # The wall reaches to the right border: its light counts the columns from the edge on.
    edge_px = 321.0 - image.sum(axis=1)
    time_s = readout_s * ((np.arange(65) + 0.5) / 65 - 0.5)
    # Clockwise from above: what stands still moves to the left, to u - f tan(rate t).
    expected_px = 160.5 - DETAILED.focal_length_px * np.tan(RATE_RAD_S * time_s)
    assert np.ptp(expected_px) > 10.0
    assert np.abs(edge_px - expected_px).max() < 0.6


@pytest.mark.parametrize("focus_m", [0.0, 4.0])
def test_defocus_of_a_point_on_a_wall_is_the_disc_of_the_thin_lens(
    make_renderer: RendererFactory, focus_m: float
) -> None:
    f_number, pitch_m, depth_m = 1.4, 3e-5, 0.5
    camera = PerspectiveCamera(161, 121, math.radians(30.0))
    # A wall across the whole view has one depth, and so one disc everywhere.
    wall = Item("wall", Box((0.1, 4.0, 4.0)), Pose.from_rpy((depth_m + 0.05, 0.0, 0.0)), BLACK)
    pixel_m = depth_m / camera.focal_length_px
    mark = Item("mark", Box((1e-4, pixel_m, pixel_m)), Pose.from_rpy((depth_m, 0.0, 0.0)), WHITE)
    world = World("point", (wall, mark), background=(0.0, 0.0, 0.0))
    parameters = dict(f_number=f_number, pixel_pitch_m=pitch_m, focus_distance_m=focus_m)
    kind = EFFECT_TYPES["DefocusByDepth"]
    effect = kind.factory(**parameters)
    view = make_renderer(world).prepare_perspective(camera, 4)
    sharp = view.render_linear(STILL)[..., 1].astype(np.float64)
    blurred = draw(view, STILL, plan_always(world, STILL, camera, effect))[..., 1]
    view.close()
    assert blurred.sum() == pytest.approx(sharp.sum(), rel=1e-3), "no light is lost"
    added = variance_px2(blurred) - variance_px2(sharp)
    # As a text book has it: f^2 / (N (Z_f - f)) |Z - Z_f| / Z for a focus at Z_f.
    focus = 1.0 / focus_m if focus_m else 0.0
    focal_m = 1.0 / (1.0 / (camera.focal_length_px * pitch_m) + focus)
    disc_m = focal_m**2 / f_number * abs(1.0 / depth_m - focus) / (1.0 - focal_m * focus)
    disc_px = disc_m / pitch_m
    assert 3.0 < disc_px < 16.0
    assert math.sqrt(16.0 * added) == pytest.approx(disc_px, rel=0.01)


def variance_px2(image: Floats) -> float:
    """Mean variance along both axes of the light in an image."""
    v, u = np.indices(image.shape)
    total = image.sum()
    squares = [
        float((image * (axis - (image * axis).sum() / total) ** 2).sum() / total) for axis in (u, v)
    ]
    return 0.5 * sum(squares)


@pytest.mark.parametrize("name", NAMES)
def test_change_of_a_frame_stays_within_the_bound(name: str) -> None:
    world = make_test_world()
    trace = TraceRenderer(build_scene(world), world, threads=2)
    view = trace.prepare_perspective(CAMERA, 2)
    *others, effect = find_chain(name)
    plan = plan_always(world, STATE, CAMERA, *others, effect)
    before = draw(view, STATE, plan_always(world, STATE, CAMERA, *others))
    after = draw(view, STATE, plan)
    trace.close()
    decision = plan.decisions[-1]
    change = 255.0 * np.abs(srgb_from_linear(after) - srgb_from_linear(before)).max()
    # 0.05: linear images are float32, and the renderer's instants are no continuum.
    assert change <= decision.bound + 0.05
