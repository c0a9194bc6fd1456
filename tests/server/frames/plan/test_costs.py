"""Cost model: recovery of known rates, storage by conditions, corrections by drawn frames."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.scene.fog import Fog
from catoptra_server.frames.plan import costs as cost_cache
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import (
    CostCache,
    CostCorrections,
    CostModel,
    PlanTiming,
    added_ms,
    describe_rates,
    fit_cost_model,
    hash_scene,
)
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import AccuracyTarget, PerPixel, RenderPlan, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.scene_mesh import build_scene
from helpers.standing_things import bake_scene, make_box_world
from helpers.worlds import make_omni_camera, make_test_world

CAMERA = make_omni_camera(width_px=640)
RATES = {"faces": (2.0, 20.0, 5.0), "mirror": (0.5, 9.0, 3.0), "readback": (0.3, 0.0)}
TRUE_MODEL = CostModel(CAMERA, {"raster": RATES})


def make_plan(kind: RendererKind, samples: int, texels_per_px: float = 1.0) -> RenderPlan:
    settings = RenderSettings(samples=samples, texels_per_px=texels_per_px)
    return plan_from_settings(settings, CAMERA, kind=kind, reason="test")


def raster_plan(samples: int, texels_per_px: float, face_samples: int = 1) -> RenderPlan:
    plan = make_plan(RendererKind.RASTER, samples, texels_per_px)
    return replace(plan, face_samples=face_samples)


MEASURED_PLANS = [
    raster_plan(1, 0.5),
    raster_plan(1, 1.0),
    raster_plan(2, 1.0),
    raster_plan(1, 1.0, 4),
]


def test_model_fitted_to_a_few_plans_predicts_others() -> None:
    model = fit_cost_model(
        CAMERA, [PlanTiming(plan, TRUE_MODEL.predict_stage_ms(plan)) for plan in MEASURED_PLANS]
    )
    for plan in (raster_plan(8, 0.5), raster_plan(3, 4.0), raster_plan(4, 2.0, 4)):
        assert model.predict_frame_ms(plan) == pytest.approx(
            TRUE_MODEL.predict_frame_ms(plan), rel=1e-6
        )


def test_rates_in_a_log_are_words_and_rounded_numbers() -> None:
    rates = {"raster": {"faces": (1.5591839844747946, 3.794824941659078), "other": (0.05, 0.0)}}
    assert describe_rates(rates) == (
        "raster faces 1.56 ms + 3.79 ms/million; raster other 0.05 ms + 0 ms/million"
    )


def test_model_of_noisy_times_has_no_negative_rates() -> None:
    rng = np.random.default_rng(3)
    measured = [
        PlanTiming(
            p, {s: ms * rng.uniform(0.7, 1.3) for s, ms in TRUE_MODEL.predict_stage_ms(p).items()}
        )
        for p in MEASURED_PLANS
    ]
    rates = fit_cost_model(CAMERA, measured).rates["raster"]
    assert all(rate >= 0.0 for stage in rates.values() for rate in stage)


def test_rates_of_decreasing_times_are_their_mean() -> None:
    times_ms = ((1, 2.0), (2, 1.0))
    measured = [PlanTiming(make_plan(RendererKind.TRACE, n), {"other": ms}) for n, ms in times_ms]
    fixed, growing = fit_cost_model(CAMERA, measured).rates["trace"]["other"]
    assert growing == 0.0
    assert 1.0 < fixed < 2.0


def test_prediction_for_an_unmeasured_group_raises() -> None:
    with pytest.raises(KeyError, match="trace"):
        TRUE_MODEL.predict_frame_ms(make_plan(RendererKind.TRACE, 1))


@pytest.mark.parametrize("rates", [(1.0, 20.0, 0.0), (1.0, 0.0, 9.0), (0.5, 12.0, 3.0)])
def test_model_of_trace_predicts_between_all_samples_and_those_of_edges(
    rates: tuple[float, ...],
) -> None:
    true = CostModel(CAMERA, {"trace": {"trace": rates}})
    plans = [make_plan(RendererKind.TRACE, samples) for samples in range(1, 9)]
    measured = [PlanTiming(plans[i], true.predict_stage_ms(plans[i])) for i in (0, 1, 4)]
    model = fit_cost_model(CAMERA, measured)
    for plan in plans:
        assert model.predict_frame_ms(plan) == pytest.approx(true.predict_frame_ms(plan))


SCENE = build_scene(make_test_world())
STORED_RATES = {"raster": {"faces": (1.0, 2.5, 0.0), "readback": (0.25, 0.0)}}


def test_stored_rates_are_read_again(tmp_path: Path) -> None:
    key = CostCache(tmp_path / "deep/costs", SCENE).make_key("llvmpipe", CAMERA, PerPixel())
    CostCache(tmp_path / "deep/costs", SCENE).write(key, STORED_RATES)
    assert CostCache(tmp_path / "deep/costs", SCENE).read(key) == STORED_RATES
    assert [path.suffix for path in (tmp_path / "deep/costs").iterdir()] == [".json"]


def test_key_depends_on_everything_that_costs_depend_on(tmp_path: Path) -> None:
    cache = CostCache(tmp_path, SCENE)
    exact, split = PerPixel(), Tessellation(8, 8)
    other = CostCache(tmp_path, replace(SCENE, corners=SCENE.corners + 1.0))
    keys = {
        cache.make_key("a", CAMERA, exact),
        cache.make_key("b", CAMERA, exact),
        cache.make_key("a", make_omni_camera(width_px=65), exact),
        cache.make_key("a", CAMERA, split),
        other.make_key("a", CAMERA, exact),
    }
    assert len(keys) == 5


@pytest.mark.parametrize("text", ["", "[]", "[1]", '{"raster": 3}', '{"raster": {"a": ["x"]}}'])
def test_malformed_file_reads_as_absent(tmp_path: Path, text: str) -> None:
    (tmp_path / "key.json").write_text(text)
    assert not CostCache(tmp_path, SCENE).read("key")


def test_unwritable_cache_is_logged_only(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "file").write_text("in the way")
    CostCache(tmp_path / "file", SCENE).write("key", STORED_RATES)
    assert "cannot be stored" in caplog.text


def test_cache_without_a_folder_stores_nothing() -> None:
    CostCache(None, SCENE).write("key", STORED_RATES)
    assert CostCache(None, SCENE).read("key") is None


def test_digest_of_a_scene_follows_its_content() -> None:
    assert hash_scene(SCENE) == hash_scene(build_scene(make_test_world()))


def test_digest_of_a_scene_follows_the_colours_of_its_corners() -> None:
    coloured = replace(SCENE, corner_albedo=np.zeros_like(SCENE.corners))
    assert hash_scene(coloured) != hash_scene(SCENE)


def test_digest_of_a_scene_counts_its_ambient_occlusion() -> None:
    occluded = bake_scene(make_box_world())
    assert occluded.occlusion is not None
    assert hash_scene(occluded) != hash_scene(replace(occluded, occlusion=None))


@pytest.mark.parametrize(
    ("cpu_info", "name"),
    [
        ("processor : 0\nmodel name : X 1\n", None),
        ("processor : 0\n", "aarch64"),
        (None, "aarch64"),
    ],
)
def test_processor_that_the_kernel_names_needs_no_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cpu_info: str | None, name: str | None
) -> None:
    def run_a_process() -> str:
        assert name is not None, "a process of its own for what a file says"
        return name

    if cpu_info is not None:
        (tmp_path / "cpuinfo").write_text(cpu_info)
    monkeypatch.setattr(cost_cache, "_CPU_INFO", tmp_path / "cpuinfo")
    monkeypatch.setattr(cost_cache.platform, "processor", run_a_process)
    assert (
        len(CostCache(None, build_scene(make_test_world())).make_key("trace", CAMERA, PerPixel()))
        == 32
    )


TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
SPEC = OmniCameraSpec(CAMERA, RenderSettings())


def test_frames_without_corrections_take_the_time_of_the_model() -> None:
    assert CostCorrections().correct(SPEC, TRACE, 5.0) == 5.0


def test_effects_are_added_and_load_multiplies() -> None:
    corrections = CostCorrections()
    corrections.update(SPEC, TRACE, 10.0, median_ms=35.0, added_ms=20.0)
    assert corrections.load_factor(TRACE) == 1.5
    # Not 3.5 times as long, as one factor for all would make of it.
    assert corrections.correct(SPEC, TRACE, 40.0) == 80.0


def test_effects_by_a_renderer_not_yet_drawn_take_as_long_as_by_the_other() -> None:
    corrections = CostCorrections()
    corrections.update(SPEC, TRACE, 10.0, median_ms=35.0, added_ms=20.0)
    assert corrections.correct(SPEC, RASTER, 10.0) == 30.0
    corrections.update(SPEC, RASTER, 10.0, median_ms=12.0, added_ms=2.0)
    assert corrections.correct(SPEC, RASTER, 10.0) == 12.0
    assert corrections.correct(SPEC, TRACE, 10.0) == 35.0


def test_added_times_belong_to_a_camera_with_its_effects_whatever_the_target() -> None:
    corrections = CostCorrections()
    corrections.update(SPEC, TRACE, 10.0, median_ms=30.0, added_ms=20.0)
    settings = replace(SPEC.render_settings, accuracy_target=AccuracyTarget(1.0))
    assert corrections.correct(replace(SPEC, render_settings=settings), TRACE, 10.0) == 30.0
    fog = EffectSettings((EffectSetting(Fog(0.1, 1.0, 1.0, 1.0), EffectMode.ALWAYS),))
    assert corrections.correct(replace(SPEC, effect_settings=fog), TRACE, 10.0) == 10.0
    corrections.clear()
    assert corrections.correct(SPEC, TRACE, 10.0) == 10.0


@pytest.mark.parametrize(("median_ms", "factor"), [(1e6, 10.0), (1e-6, 0.1), (-1.0, 0.1)])
def test_incredible_times_are_limited(median_ms: float, factor: float) -> None:
    corrections = CostCorrections()
    corrections.update(SPEC, TRACE, 10.0, median_ms=median_ms, added_ms=0.0)
    assert corrections.load_factor(TRACE) == factor


def test_stages_of_the_model_and_time_samples_are_not_added() -> None:
    stage_ms = {"trace": 5.0, "accumulate": 7.0, "Fog": 1.0, "encode": 0.5}
    assert added_ms(stage_ms, {"trace", "other"}) == 1.5
