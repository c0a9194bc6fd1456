"""Corrections of predicted times: a factor a renderer, and added times of effects."""

from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_server.effects.effect import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import CostCorrections, added_ms
from catoptra_server.render.render_settings import AccuracyTarget, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from helpers.worlds import make_omni_camera

TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
CAMERA = OmniCameraSpec(make_omni_camera(width_px=16), RenderSettings())


def test_frames_without_corrections_take_the_time_of_the_model() -> None:
    assert CostCorrections().correct(CAMERA, TRACE, 5.0) == 5.0


def test_effects_are_added_and_load_multiplies() -> None:
    corrections = CostCorrections()
    corrections.update(CAMERA, TRACE, 10.0, median_ms=35.0, added_ms=20.0)
    assert corrections.factor(TRACE) == 1.5
    # Not 3.5 times as long, as one factor for all would make of it.
    assert corrections.correct(CAMERA, TRACE, 40.0) == 80.0


def test_effects_by_a_renderer_not_yet_drawn_take_as_long_as_by_the_other() -> None:
    corrections = CostCorrections()
    corrections.update(CAMERA, TRACE, 10.0, median_ms=35.0, added_ms=20.0)
    assert corrections.correct(CAMERA, RASTER, 10.0) == 30.0
    corrections.update(CAMERA, RASTER, 10.0, median_ms=12.0, added_ms=2.0)
    assert corrections.correct(CAMERA, RASTER, 10.0) == 12.0
    assert corrections.correct(CAMERA, TRACE, 10.0) == 35.0


def test_added_times_belong_to_a_camera_with_its_effects_whatever_the_target() -> None:
    corrections = CostCorrections()
    corrections.update(CAMERA, TRACE, 10.0, median_ms=30.0, added_ms=20.0)
    settings = replace(CAMERA.render_settings, accuracy_target=AccuracyTarget(1.0))
    assert corrections.correct(replace(CAMERA, render_settings=settings), TRACE, 10.0) == 30.0
    fog = EffectSettings((EffectSetting(Fog(0.1, 1.0, 1.0, 1.0), EffectMode.ALWAYS),))
    assert corrections.correct(replace(CAMERA, effect_settings=fog), TRACE, 10.0) == 10.0
    corrections.clear()
    assert corrections.correct(CAMERA, TRACE, 10.0) == 10.0


@pytest.mark.parametrize(("median_ms", "factor"), [(1e6, 10.0), (1e-6, 0.1), (-1.0, 0.1)])
def test_incredible_times_are_limited(median_ms: float, factor: float) -> None:
    corrections = CostCorrections()
    corrections.update(CAMERA, TRACE, 10.0, median_ms=median_ms, added_ms=0.0)
    assert corrections.factor(TRACE) == factor


def test_stages_of_the_model_and_time_samples_are_not_added() -> None:
    stage_ms = {"trace": 5.0, "accumulate": 7.0, "Fog": 1.0, "encode": 0.5}
    assert added_ms(stage_ms, {"trace", "other"}) == 1.5
