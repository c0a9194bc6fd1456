"""The passes of a frame follow from effects, ranges and shutter; none exists without a use."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings, Threshold
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import apply_scene_effects, plan_effects
from catoptra_server.effects.kernels.grey_levels import measure_change
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import MirrorSurface, PerPixel
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import FogMedium, Shutter
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Twist, srgb_from_linear
from helpers.effect_measurement import CAMERA, DRIVING_STATE, make_effect
from helpers.image_changers import open_changer_or_skip
from helpers.image_comparison import level_differences
from helpers.opengl import make_raster
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world


@pytest.mark.parametrize("has_ranges", [False, True])
@pytest.mark.parametrize("has_shutter", [False, True])
def test_exposure_has_only_the_passes_that_are_needed(
    device: GlDevice, has_ranges: bool, has_shutter: bool
) -> None:
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA))
    state = replace(DRIVING_STATE, shutter=SHUTTER) if has_shutter else CAMERA_STATE
    before = view.memory_bytes
    light = view.render_linear(state, EFFECTS[:1] if has_ranges else ())
    image_passes = ("accumulate",) if has_shutter else ("faces", "mirror")
    assert view.pass_names == image_passes + ("ranges",) * has_ranges
    assert view.memory_bytes - before >= 16 * CAMERA.width_px * CAMERA.height_px
    assert light.shape == (CAMERA.height_px, CAMERA.width_px, 3)
    assert light.max() > 0.1
    view.close()


FOG = FogMedium(0.1, (0.5, 0.5, 0.5))
SHUTTER = Shutter(exposure_s=0.02, readout_s=0.0, num_steps=2.0)


LENS = PerspectiveCamera(60, 40, 1.4)


@pytest.mark.parametrize("is_lens", [False, True])
@pytest.mark.parametrize("fog", [None, FOG])
@pytest.mark.parametrize(
    ("effects", "shutter", "names"),
    [
        ((), None, ("faces", "image")),
        (("Vignetting",), None, ("faces", "image")),
        (("DefocusByDepth",), None, ("faces", "image", "ranges")),
        ((), SHUTTER, ("accumulate", "encode")),
    ],
)
def test_passes_when_rendered_are_those_of_effects_and_shutter_and_none_of_fog(
    device: GlDevice,
    effects: tuple[str, ...],
    shutter: Shutter | None,
    names: tuple[str, ...],
    fog: FogMedium | None,
    is_lens: bool,
) -> None:
    renderer, image = make_raster(device), "average" if is_lens else "mirror"
    view = (
        renderer.prepare_perspective(LENS, 2)
        if is_lens
        else renderer.prepare(CAMERA, make_plan(CAMERA))
    )
    state = replace(CAMERA_STATE, fog=fog, shutter=shutter)
    view.render(state, tuple(make_effect(name) for name in effects))
    assert view.pass_names == tuple(image if name == "image" else name for name in names)
    view.close()


def test_linear_light_without_effects_is_what_the_plain_pass_encodes(device: GlDevice) -> None:
    renderer = make_raster(device)
    view = renderer.prepare_perspective(LENS, 2)
    light = view.render_linear(CAMERA_STATE)
    assert light.shape == (40, 60, 3)
    plain = view.render(CAMERA_STATE).rgb
    # Brighter pixels have higher codes: rows are not flipped between the two sequences.
    order = np.argsort(light[..., 0].ravel(), kind="stable")
    assert (np.diff(plain[..., 0].ravel()[order].astype(int)) >= -1).all()
    view.close()


def test_linear_image_when_read_is_the_encoded_one(device: GlDevice) -> None:
    effects = (make_effect("Vignetting"),)
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA))
    light, rgb = view.render_linear(CAMERA_STATE, effects), view.render(CAMERA_STATE, effects).rgb
    assert (light.dtype, light.shape) == (np.float32, rgb.shape)
    # Half a level is rounding, the rest the table's steps.
    assert np.abs(255.0 * srgb_from_linear(light.astype(np.float64)) - rgb).max() < 0.5 + 0.03
    assert np.ptp(rgb) > 100
    view.close()


def test_view_when_rendered_by_another_thread_raises(device: GlDevice) -> None:
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA))
    errors: list[str] = []

    def draw() -> None:
        try:
            view.render(CAMERA_STATE)
        except AssertionError as error:
            errors.append(str(error))

    thread = threading.Thread(target=draw)
    thread.start()
    thread.join()
    assert errors == ["a view belongs to its renderer's thread"]
    view.close()


EFFECTS = tuple(
    make_effect(name, changes)
    for name, changes in (
        ("DefocusByDepth", {"f_number": 2.0, "pixel_pitch_m": 1.1e-5}),
        ("Vignetting", {}),
        ("Exposure", {"exposure_s": 0.02}),
        ("ShotNoise", {}),
    )
)


@pytest.mark.parametrize("surface", [PerPixel(), Tessellation(16, 16)])
@pytest.mark.parametrize("samples", [1, 2])
def test_image_when_no_effect_changes_it_is_the_usual_one(
    device: GlDevice, surface: MirrorSurface, samples: int
) -> None:
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA, surface, samples=samples))
    usual = view.render(CAMERA_STATE).rgb
    encoded = srgb_from_linear(view.render_linear(CAMERA_STATE).astype(np.float64))
    assert level_differences(usual, np.rint(255.0 * encoded).astype(np.uint8)).max() <= 1
    view.close()


def test_view_without_effects_writes_no_linear_light(device: GlDevice) -> None:
    renderer = make_raster(device)
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    view.render(CAMERA_STATE)
    assert view.pass_names == ("faces", "mirror")
    assert not [name for name in renderer.program_names if "LINEAR" in name]
    view.close()


def test_view_when_a_robot_stops_and_goes_builds_nothing_anew(device: GlDevice) -> None:
    world = make_test_world()
    moving = (RollingShutter(0.05), MotionBlur(1.0 / 60.0))
    named = EffectSettings(
        tuple(EffectSetting(effect, EffectMode.AUTO) for effect in (*moving, *EFFECTS[1:]))
    )
    summaries = SceneSummarizer(build_scene(world), world)
    view = make_raster(device).prepare(CAMERA, make_plan(CAMERA))
    built: dict[bool, object] = {}
    faster = (0.0, *np.geomspace(0.03, 3.0, 9))
    for speed_m_s in (*faster, *reversed(faster)) * 3:
        camera_state = replace(CAMERA_STATE, twist=Twist((speed_m_s, 0.0, 0.0)))
        plan = plan_effects(named, summaries.summarize(camera_state, CAMERA), CAMERA)
        lasting = apply_scene_effects(camera_state, plan)
        view.render(lasting, plan.image_effects)
        last_pass = view.active_passes[-1]
        assert built.setdefault(lasting.shutter is None, last_pass) is last_pass
    assert len(built) == 2
    view.close()


def test_effects_by_the_kernel_are_those_of_numpy(device: GlDevice) -> None:
    plan = make_plan(CAMERA, samples=2)
    with ExitStack() as stack:
        changer = open_changer_or_skip(stack)
        numpy = make_raster(device).prepare(CAMERA, plan)
        native = make_raster(device, changer=changer).prepare(CAMERA, plan)
        for view in (numpy, native):
            stack.callback(view.close)
        for state in (CAMERA_STATE, DRIVING_STATE):
            images = [view.render_linear(state, EFFECTS) for view in (numpy, native)]
            np.testing.assert_allclose(*images, atol=1e-4)
            frames = [view.render(state, EFFECTS).rgb for view in (numpy, native)]
            assert level_differences(*frames).max() <= 1


def test_effects_by_the_kernel_are_measured_and_have_no_passes(device: GlDevice) -> None:
    thresholds = {effect.name: Threshold(0.5) for effect in EFFECTS}
    with ExitStack() as stack:
        view = make_raster(device, changer=open_changer_or_skip(stack)).prepare(
            CAMERA, make_plan(CAMERA)
        )
        stack.callback(view.close)
        image = view.render(CAMERA_STATE, EFFECTS, thresholds)
        assert view.pass_names == ("faces", "mirror", "ranges")
        view.render(CAMERA_STATE, EFFECTS[1:])
        assert view.pass_names == ("faces", "mirror")
        before = view.render_linear(CAMERA_STATE, EFFECTS[:2])
        after = view.render_linear(CAMERA_STATE, EFFECTS[:3])
    assert set(thresholds) <= set(image.changes)
    assert image.changes["Exposure"].largest == pytest.approx(
        measure_change(before, after).largest, abs=0.6
    )
    assert image.changes["Exposure"].largest > 1.0
    assert list(image.stage_ms)[:4] == ["faces", "mirror", "ranges", "readback"]
    assert set(thresholds) < set(image.stage_ms)
    assert not image.rgb.flags.writeable
