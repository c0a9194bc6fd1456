from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects.effect import CaptureContext
from catoptra_server.render.render_settings import MirrorSurface, PerPixel
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.trace_engine import assemble_grid
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.camera_state import NoiseSeed
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.world_description import World, srgb_from_linear
from helpers.effect_measurement import CAMERA, make_effect
from helpers.image_comparison import level_differences
from helpers.range_images import RangeRecorder
from helpers.trace_engines import ENGINES, open_renderer
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world

CHAIN = (make_effect("Vignetting"), make_effect("ShotNoise"), make_effect("Bayer"))


@pytest.fixture(params=ENGINES)
def renderer(request: pytest.FixtureRequest) -> Iterator[TraceRenderer]:
    with open_renderer(request.param, make_test_world(), threads=2) as renderer:
        yield renderer


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(16, 16)])
@pytest.mark.parametrize("samples", [1, 2])
def test_image_when_no_effect_changes_it_is_the_usual_one(
    renderer: TraceRenderer, surface: MirrorSurface, samples: int
) -> None:
    plan = make_plan(CAMERA, surface, samples=samples)
    view = renderer.prepare(CAMERA, plan)
    encoded = srgb_from_linear(view.render_linear(CAMERA_STATE).astype(np.float64))
    difference = level_differences(
        view.render(CAMERA_STATE).rgb, np.rint(255.0 * encoded).astype(np.uint8)
    )
    # A sample brighter than white is clipped by itself in the one, with its pixel in the other.
    assert (difference > 1).mean() < 0.01
    assert np.median(difference) == 0


def test_image_with_effects_is_their_result_on_the_linear_image(
    renderer: TraceRenderer,
) -> None:
    plan = make_plan(CAMERA, samples=2)
    view = renderer.prepare(CAMERA, plan)
    light = view.render_linear(CAMERA_STATE).astype(np.float64)
    for effect in CHAIN:
        light = effect.apply(light, CAMERA, CaptureContext(CAMERA_STATE.noise_seed))
    rendered = view.render_linear(CAMERA_STATE, CHAIN)
    np.testing.assert_allclose(rendered, light, atol=1e-6)


def test_stages_when_timed_have_the_effects_names(renderer: TraceRenderer) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    stages = tuple(view.render(CAMERA_STATE, CHAIN).stage_ms)
    assert stages == ("trace", "Vignetting", "ShotNoise", "Bayer", "encode")
    view.close()


def test_frame_when_rendered_twice_has_the_same_bytes_and_the_next_one_others(
    renderer: TraceRenderer,
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    first, again = view.render(CAMERA_STATE, CHAIN).rgb, view.render(CAMERA_STATE, CHAIN).rgb
    later = view.render(replace(CAMERA_STATE, noise_seed=NoiseSeed(tick=1)), CHAIN).rgb
    assert not first.flags.writeable
    np.testing.assert_array_equal(first, again)
    assert (first != later).mean() > 0.3


def test_ranges_when_an_effect_needs_them_are_those_of_the_frames_own_rays(
    renderer: TraceRenderer,
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA, samples=2))
    before = view.memory_bytes
    recorder = RangeRecorder(CHAIN[0])
    rendered = view.render(CAMERA_STATE, (recorder,))  # type: ignore[arg-type]
    assert "ranges" not in rendered.stage_ms
    assert view.memory_bytes == before
    table = omni_ray_table(CAMERA, make_plan(CAMERA, samples=2))
    hits = view._rays.find_hits(CAMERA_STATE)
    inverse = assemble_grid(table, 1.0 / hits.range_m[..., None], fill=np.float32(0.0))[..., 0]
    height, width = CAMERA.height_px, CAMERA.width_px
    means = inverse.astype(np.float64).reshape(height, 2, width, 2).mean(axis=(1, 3))
    assert recorder.range_m is not None
    np.testing.assert_allclose(1.0 / recorder.range_m, means, rtol=1e-4, atol=1e-7)
    view.close()


@pytest.mark.parametrize("engine", ENGINES)
def test_light_brighter_than_white_is_passed_on_unchanged(engine: EngineName) -> None:
    world = World("glare", (), background=(4.0, 2.0, 0.5))
    with open_renderer(engine, world) as renderer:
        light = renderer.prepare(CAMERA, make_plan(CAMERA)).render_linear(CAMERA_STATE)
    np.testing.assert_allclose(light[48, 20], (4.0, 2.0, 0.5), rtol=1e-5)
