"""The cost of effects on the device, counted in passes, programs and textures."""

from __future__ import annotations

from dataclasses import replace

import moderngl
import numpy as np
import pytest

from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect import EffectMode, EffectSetting, EffectSettings, ImageEffect
from catoptra_server.effects.effect_plan import apply_scene_effects, plan_effects
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.effect_chain import EffectChain
from catoptra_server.render.raster.gl_device import GlDevice
from catoptra_server.render.raster.shader_programs import ShaderPrograms
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.mirror_mesh import Tessellation
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.twist import Twist
from helpers.effect_measurement import CAMERA, make_effect
from helpers.image_comparison import level_differences
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world

NOISY = (make_effect("Vignetting"), make_effect("ShotNoise"), make_effect("ReadNoise"))
METERED = (make_effect("AutoExposure"),)


@pytest.fixture
def renderer(device: GlDevice) -> RasterRenderer:
    world = make_test_world()
    return RasterRenderer(build_scene(world), world, device=device)


@pytest.mark.parametrize(
    ("effects", "passes", "programs"),
    [
        ((), ("faces", "mirror"), 1),
        (NOISY, ("faces", "mirror", "Vignetting", "ShotNoise", "ReadNoise", "encode"), 5),
        (METERED, ("faces", "mirror", "AutoExposure", "encode"), 4),
    ],
)
def test_view_when_effects_run_has_a_pass_and_a_program_for_each(
    renderer: RasterRenderer,
    effects: tuple[ImageEffect, ...],
    passes: tuple[str, ...],
    programs: int,
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    before = len(renderer.program_names)
    assert tuple(view.render(CAMERA_STATE, effects).stage_ms) == (*passes, "readback")
    assert view.pass_names == passes
    assert len(renderer.program_names) - before == programs
    assert view.num_sequences == 1
    view.close()


def test_view_without_effects_has_the_usual_passes(renderer: RasterRenderer) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    view.render(CAMERA_STATE)
    assert view.pass_names == ("faces", "mirror")
    assert not [name for name in renderer.program_names if "effect" in name or "LINEAR" in name]
    view.close()


@pytest.mark.parametrize(("count", "images"), [(0, 1), (1, 2), (2, 2), (7, 2)])
def test_chain_however_long_has_two_images_at_most(
    device: GlDevice, count: int, images: int
) -> None:
    context = device.context
    with context:
        target = context.framebuffer([context.renderbuffer((96, 96), 3)])
        created = record_textures(context)
        effects = (make_effect("Vignetting"),) * count
        chain = EffectChain(context, ShaderPrograms(context), effects, CAMERA, target)
        assert len(created) == images
        chain.close()


def record_textures(context: moderngl.Context) -> list[moderngl.Texture]:
    """A list of every texture created in a context from now on."""
    created: list[moderngl.Texture] = []
    make = type(context).texture

    class RecordingContext(type(context)):  # type: ignore[misc]
        def texture(self, *arguments: object, **named: object) -> moderngl.Texture:
            created.append(make(self, *arguments, **named))
            return created[-1]

    context.__class__ = RecordingContext
    return created


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(16, 16)])
@pytest.mark.parametrize("samples", [1, 2])
def test_image_when_no_effect_changes_it_is_the_usual_one(
    renderer: RasterRenderer, surface: MirrorSurface, samples: int
) -> None:
    plan = make_plan(CAMERA, surface, samples=samples)
    view = renderer.prepare(CAMERA, plan)
    usual = view.render(CAMERA_STATE).rgb
    encoded = srgb_from_linear(view.render_linear(CAMERA_STATE).astype(np.float64))
    assert level_differences(usual, np.rint(255.0 * encoded).astype(np.uint8)).max() <= 1
    view.close()


def test_frame_when_rendered_twice_has_the_same_bytes(renderer: RasterRenderer) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    np.testing.assert_array_equal(
        view.render(CAMERA_STATE, NOISY).rgb, view.render(CAMERA_STATE, NOISY).rgb
    )
    view.close()


def test_view_when_effects_change_keeps_the_last_four_lists_ready(
    renderer: RasterRenderer,
) -> None:
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    for effects in (NOISY, METERED, NOISY, NOISY[:1], NOISY[1:], NOISY[:2], NOISY):
        view.render(CAMERA_STATE, effects)
    assert view.num_sequences == 4
    view.close()


def test_view_when_a_robot_stops_and_goes_builds_nothing_anew(renderer: RasterRenderer) -> None:
    world = make_test_world()
    moving = (RollingShutter(0.05), MotionBlur(1.0 / 60.0))
    named = EffectSettings(
        tuple(EffectSetting(effect, EffectMode.AUTO) for effect in (*moving, *NOISY))
    )
    summaries = SceneSummarizer(build_scene(world), world)
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    built: dict[bool, object] = {}
    faster = (0.0, *np.geomspace(0.03, 3.0, 9))
    for speed_m_s in (*faster, *reversed(faster)) * 3:
        camera_state = replace(CAMERA_STATE, twist=Twist((speed_m_s, 0.0, 0.0)))
        plan = plan_effects(named, summaries.summarize(camera_state, CAMERA), CAMERA)
        lasting = apply_scene_effects(camera_state, plan)
        view.render(lasting, plan.image_effects)
        assert (
            built.setdefault(lasting.shutter is None, view.active_passes[-1])
            is view.active_passes[-1]
        )
    assert len(built) == 2
    view.close()
