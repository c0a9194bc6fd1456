"""Measured frames overrule the rule where another renderer has a clear advantage."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.cost_cache import CostCache
from catoptra_server.planning.effect_rates import RenderEngine
from catoptra_server.planning.renderer_preferences import WINDOW_FRAMES, RendererPreferences
from catoptra_server.planning.renderer_rule import (
    ImageLoad,
    RendererRule,
    SceneLoad,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import AccuracyTarget, RenderSettings
from catoptra_server.scene.scene_mesh import build_scene
from helpers.worlds import make_omni_camera, make_test_world

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
ENGINES = {TRACE: RenderEngine.KERNEL, RASTER: RenderEngine.SOFTWARE_OPENGL}
RULE = RendererRule(SceneLoad(2000, has_textures=False, num_point_lights=0), ENGINES)
CAMERA = OmniCameraSpec(make_omni_camera(width_px=640), RenderSettings(samples=2))
IMAGE = ImageLoad.from_camera(CAMERA.camera, CAMERA.render_settings)
RASTER_MS = RULE.predict_frame_ms(RASTER, IMAGE) or 0.0


def make_preferences(
    rule: RendererRule | None = RULE, cache: CostCache | None = None, device: str = "device"
) -> RendererPreferences:
    return RendererPreferences(rule, cache, device)


def draw_frames(
    preferences: RendererPreferences, ms: float, *, frames: int = WINDOW_FRAMES
) -> RendererPreferences:
    for _ in range(frames):
        preferences.record_frame(CAMERA, ms)
    return preferences


def test_choice_without_measured_frames_is_the_default() -> None:
    assert make_preferences().choose(CAMERA, TRACE, "rule") == (TRACE, "rule")


@pytest.mark.parametrize(("raster_ms", "kind"), [(7.9, RASTER), (8.1, TRACE), (30.0, TRACE)])
def test_renderer_changes_only_with_a_clear_advantage(raster_ms: float, kind: RendererKind) -> None:
    preferences = draw_frames(make_preferences(), 10.0)
    preferences.record_comparison(CAMERA, {TRACE: 10.0, RASTER: raster_ms})
    chosen, reason = preferences.choose(CAMERA, TRACE, "rule")
    assert chosen is kind
    assert (
        reason == f"trace 10.0 ms, raster {raster_ms} ms a frame, measured in turn on this machine"
    )


@pytest.mark.parametrize(
    ("drawn_ms", "rival"),
    [(0.5 * RASTER_MS, None), (0.7 * RASTER_MS, RASTER), (2.0 * RASTER_MS, RASTER)],
)
def test_rival_is_tried_where_drawn_frames_are_not_much_faster_than_its_rule(
    drawn_ms: float, rival: RendererKind | None
) -> None:
    assert draw_frames(make_preferences(), drawn_ms).find_rival(CAMERA, TRACE) is rival


def test_rival_is_not_tried_before_the_window_is_full() -> None:
    preferences = draw_frames(make_preferences(), 1e3, frames=WINDOW_FRAMES - 1)
    assert preferences.find_rival(CAMERA, TRACE) is None


def test_single_slow_frames_do_not_start_a_trial() -> None:
    preferences = draw_frames(make_preferences(), 1.0)
    draw_frames(preferences, 1e4, frames=WINDOW_FRAMES // 2 - 1)
    assert preferences.find_rival(CAMERA, TRACE) is None


def test_rival_that_lost_is_tried_again_only_after_many_slow_frames() -> None:
    preferences = draw_frames(make_preferences(), 2.0 * RASTER_MS)
    preferences.record_comparison(CAMERA, {TRACE: 20.0, RASTER: 40.0})
    assert draw_frames(preferences, 60.0).find_rival(CAMERA, TRACE) is None
    assert draw_frames(preferences, 60.0, frames=1000).find_rival(CAMERA, TRACE) is RASTER
    # A frame at the measured time of the renderer itself gives no reason to try the other one.
    assert draw_frames(preferences, 20.0).find_rival(CAMERA, TRACE) is None
    preferences.record_comparison(CAMERA, {TRACE: 20.0, RASTER: 40.0})
    assert draw_frames(preferences, 60.0, frames=1999).find_rival(CAMERA, TRACE) is None
    assert draw_frames(preferences, 60.0, frames=1).find_rival(CAMERA, TRACE) is RASTER


def test_renderer_without_rates_has_no_rival_before_it_is_measured() -> None:
    only_trace = RendererRule(RULE.scene, {TRACE: RenderEngine.KERNEL})
    preferences = draw_frames(make_preferences(only_trace), 1e3)
    assert preferences.find_rival(CAMERA, TRACE) is None
    assert preferences.find_rival(CAMERA, RASTER) is TRACE


def test_abandoned_camera_is_not_tried_again() -> None:
    preferences = draw_frames(make_preferences(), 1e3)
    preferences.abandon(CAMERA)
    assert preferences.find_rival(CAMERA, TRACE) is None


@pytest.mark.parametrize(
    ("rule", "settings"),
    [(None, CAMERA.render_settings), (RULE, RenderSettings(accuracy_target=AccuracyTarget(1.0)))],
    ids=["final choice", "accuracy target"],
)
def test_final_choices_and_accuracy_targets_are_not_compared(
    rule: RendererRule | None, settings: RenderSettings
) -> None:
    preferences, camera = make_preferences(rule), OmniCameraSpec(CAMERA.camera, settings)
    for _ in range(WINDOW_FRAMES):
        preferences.record_frame(camera, 1e3)
    assert preferences.find_rival(camera, TRACE) is None
    assert preferences.choose(camera, TRACE, "final") == (TRACE, "final")


def test_measured_times_are_kept_for_the_next_run(tmp_path: Path) -> None:
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    first = draw_frames(make_preferences(cache=cache), 50.0)
    first.record_comparison(CAMERA, {TRACE: 50.0, RASTER: 10.0})
    kind, reason = make_preferences(cache=cache).choose(CAMERA, TRACE, "rule")
    assert kind is RASTER
    assert reason.endswith("measured in an earlier run")
    elsewhere = make_preferences(cache=cache, device="another device")
    assert elsewhere.choose(CAMERA, TRACE, "rule") == (TRACE, "rule")


@pytest.mark.parametrize("text", ["{}", '{"trace": {}}', '{"trace": {"frame": []}}', '{"x": {}}'])
def test_kept_file_of_another_form_is_ignored(tmp_path: Path, text: str) -> None:
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    draw_frames(make_preferences(cache=cache), 1.0).record_comparison(CAMERA, {TRACE: 1.0})
    (file,) = tmp_path.iterdir()
    file.write_text(text, encoding="utf-8")
    assert make_preferences(cache=cache).choose(CAMERA, TRACE, "rule") == (TRACE, "rule")
