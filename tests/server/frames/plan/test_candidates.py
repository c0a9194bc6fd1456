"""Candidate plans, times of the calibration plans, and tables of both."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import CostCache, PlanTiming, fit_cost_model
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.planner import (
    FACE_SAMPLE_COUNTS,
    OTHER_STAGES,
    SAMPLE_COUNTS,
    TEXELS_PER_PX,
    RendererCalibration,
    generate_calibration_plans,
    generate_candidate_plans,
    measure_costs,
)
from catoptra_server.frames.plan.plans import plan_view_size
from catoptra_server.render.renderer import (
    MirrorSurface,
    PerPixel,
    RenderedImage,
    RenderPlan,
    RenderSettings,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.invented_costs import make_pool, measure_per_sample
from helpers.worlds import make_omni_camera, make_test_world

CAMERA = make_omni_camera(width_px=64)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def candidate_plans(
    surface: MirrorSurface, *kinds: RendererKind, width_px: int = 64
) -> list[RenderPlan]:
    return list(generate_candidate_plans(surface, make_omni_camera(width_px=width_px), kinds))


def test_candidates_of_both_renderers_are_all_combinations() -> None:
    assert len(candidate_plans(PerPixel(), TRACE)) == len(SAMPLE_COUNTS)
    count = len(SAMPLE_COUNTS) * len(TEXELS_PER_PX) * len(FACE_SAMPLE_COUNTS)
    assert len(candidate_plans(PerPixel(), RASTER)) == count
    assert len(candidate_plans(PerPixel(), TRACE, RASTER)) == len(SAMPLE_COUNTS) + count


def test_candidates_of_an_exact_mirror_have_no_mesh() -> None:
    assert {plan.surface for plan in candidate_plans(PerPixel(), TRACE, RASTER)} == {PerPixel()}


def test_candidates_of_a_mesh_keep_the_mesh() -> None:
    mesh = Tessellation(16, 16)
    assert {plan.surface for plan in candidate_plans(mesh, TRACE)} == {mesh}


def test_candidates_of_a_large_image_stay_within_memory_but_for_one_sample() -> None:
    assert {plan.samples for plan in candidate_plans(PerPixel(), TRACE, width_px=2048)} == {1, 2}
    assert {plan.samples for plan in candidate_plans(PerPixel(), TRACE, width_px=8192)} == {1}


def test_candidates_of_a_large_image_keep_faces_within_memory_but_for_one_sample() -> None:
    plans = candidate_plans(PerPixel(), RASTER, width_px=2048)
    camera = make_omni_camera(width_px=2048)
    large = [p for p in plans if plan_view_size(camera, p).num_bytes > DEFAULT_LIMIT_BYTES]
    # 2048 px at 4 texels a pixel would be 0.8 GB of texels, four times as much with 4 samples each.
    assert {(plan.samples, plan.face_samples) for plan in large} <= {(1, 1)}
    assert {plan.face_samples for plan in plans} == {1, 4}


@pytest.mark.parametrize("kind", RendererKind)
def test_calibration_plans_vary_the_samples_of_their_renderer(kind: RendererKind) -> None:
    plans = list(generate_calibration_plans(kind, CAMERA, PerPixel()))
    assert {plan.renderer for plan in plans} == {kind}
    assert len({plan.samples for plan in plans}) > 1


def test_calibration_plans_of_a_large_image_stay_within_memory() -> None:
    camera = make_omni_camera(width_px=2048)
    for kind in RendererKind:
        plans = list(generate_calibration_plans(kind, camera, PerPixel()))
        assert {1, 2} <= {plan.samples for plan in plans}
        large = [p for p in plans if plan_view_size(camera, p).num_bytes > DEFAULT_LIMIT_BYTES]
        assert {(plan.samples, plan.face_samples) for plan in large} <= {(1, 1)}


STATES = (CameraState(Pose.identity()), CameraState(Pose.from_rpy((1.0, 0.0, 0.0))))


class _FakeRenderer:
    """A renderer whose frames take a millisecond a sample of a pixel, by a clock of its own."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.num_closed = 0
        self.camera_states: list[CameraState] = []

    def prepare(self, camera: OmniCamera, plan: RenderPlan) -> Any:
        renderer = self

        class FakeView:
            def render(self, camera_state: CameraState) -> RenderedImage:
                renderer.camera_states.append(camera_state)
                renderer.now_s += 1e-3 * (plan.samples**2 + 0.5)
                stages = {"trace": float(plan.samples**2)}
                return RenderedImage(np.zeros((1, 1, 3), dtype=np.uint8), stages)

            def close(self) -> None:
                renderer.num_closed += 1

        return FakeView()

    def measure(self) -> list[PlanTiming]:
        renderer: Any = self
        return measure_costs(renderer, TRACE, CAMERA, PerPixel(), STATES, clock=lambda: self.now_s)


def test_calibration_has_medians_of_all_stages_and_of_the_time_between() -> None:
    renderer = _FakeRenderer()
    found = renderer.measure()
    assert [one.plan.samples for one in found] == [1, 2, 5]
    assert [one.stage_ms["trace"] for one in found] == [1.0, 4.0, 25.0]
    assert all(one.stage_ms[OTHER_STAGES] == pytest.approx(0.5) for one in found)
    assert renderer.num_closed == 3
    assert set(renderer.camera_states) == set(STATES)


def test_calibration_when_fitted_reproduces_the_measured_times() -> None:
    renderer = _FakeRenderer()
    found = renderer.measure()
    model = fit_cost_model(CAMERA, found)
    assert model.predict_frame_ms(found[1].plan) == pytest.approx(4.5)


SPEC = OmniCameraSpec(CAMERA, RenderSettings())


def make_calibration(measure: Any, cache: CostCache | None = None) -> RendererCalibration:
    return RendererCalibration(make_pool(), cache, measure)


def make_cache(folder: Path) -> CostCache:
    return CostCache(folder, build_scene(make_test_world()))


def test_options_have_the_bound_and_the_time_of_their_plan() -> None:
    table = make_calibration(measure_per_sample(2.0)).make_table(SPEC, STATES)
    assert {option.plan.samples for option in table.options} == set(range(1, 9))
    for option in table.options:
        bound = error_bound(SPEC.camera, option.plan)
        assert option.error_bound_px == bound.outline_error_px
        assert option.predicted_ms == pytest.approx(2.0 * option.plan.samples**2)


def test_table_without_a_renderer_that_can_be_measured_is_refused() -> None:
    def fail(*_: Any) -> list[PlanTiming]:
        raise RuntimeError("lost device")

    with pytest.raises(RendererUnavailableError, match="no renderer could be measured"):
        make_calibration(fail).make_table(SPEC, STATES)


class RepeatedMeasurement:
    """Measurements that give another rate each time."""

    def __init__(self, *rates_ms: float) -> None:
        self.remaining_ms = list(rates_ms)

    def __call__(self, *arguments: Any) -> list[PlanTiming]:
        return measure_per_sample(self.remaining_ms.pop(0), fixed_ms=9.0)(*arguments)


def test_costs_that_do_not_grow_are_measured_again_and_never_stored(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    measurement = RepeatedMeasurement(0.0, 0.0, 0.0)
    make_calibration(measurement, make_cache(tmp_path)).make_table(SPEC, STATES)
    assert measurement.remaining_ms == []
    assert not list(tmp_path.iterdir())
    assert "not stored" in caplog.text


def test_second_measurement_that_grows_is_stored(tmp_path: Path) -> None:
    measurement = RepeatedMeasurement(0.0, 2.0)
    make_calibration(measurement, make_cache(tmp_path)).make_table(SPEC, STATES)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("rates", [(12.6, 0.0, 0.0), (1.0, math.nan, 2.0), (0.0, math.inf, 1.0)])
def test_stored_costs_that_mean_nothing_are_measured_anew(
    tmp_path: Path, rates: tuple[float, ...]
) -> None:
    measurement, cache = RepeatedMeasurement(2.0, 2.0), make_cache(tmp_path)
    key = cache.make_key("trace", SPEC.camera, SPEC.render_settings.surface)
    cache.write(key, {"trace": {"trace": rates}})
    for _ in range(2):
        make_calibration(measurement, cache).make_table(SPEC, STATES)
        assert measurement.remaining_ms == [2.0]
