"""Plans by settings and by targets: costs are measured once and corrected by real frames."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan import planner as candidate_table
from catoptra_server.frames.plan import plans as explicit_choice
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import CostCache, PlanTiming
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.render.renderer import AccuracyTarget, MirrorSurface, Renderer, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from helpers.invented_costs import NamedRenderer, make_pool, measure_per_sample
from helpers.worlds import make_omni_camera, make_test_world

CAMERA = make_omni_camera(width_px=100)
CAMERA_STATES = (CameraState(Pose.identity()),)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER
MS_PER_SAMPLE = {TRACE: 5.0, RASTER: 1.0}


class FakeCostMeasurement:
    """Invented measurement: milliseconds in proportion to the samples."""

    def __init__(self) -> None:
        self.measured_kinds: list[RendererKind] = []
        self.created: list[Any] = []

    def __call__(
        self,
        renderer: Renderer,
        kind: RendererKind,
        camera: OmniCamera,
        surface: MirrorSurface,
        camera_states: Sequence[CameraState],
    ) -> list[PlanTiming]:
        self.measured_kinds.append(kind)
        measure = measure_per_sample(MS_PER_SAMPLE[kind])
        return measure(renderer, kind, camera, surface, camera_states)

    def create_raster(self) -> Any:
        self.created.append(NamedRenderer("raster"))
        return self.created[-1]

    def create_planner(
        self, cache: CostCache | None = None, *, default: RendererKind = RASTER
    ) -> RenderPlanner:
        pool = make_pool(factories={RASTER: self.create_raster})
        pool.default_kind = default  # raster: as beside a graphics processor
        return RenderPlanner(pool, cache, measure=self)


def camera_spec(target: AccuracyTarget = AccuracyTarget(), **numbers: Any) -> OmniCameraSpec:  # noqa: B008 - frozen
    return OmniCameraSpec(CAMERA, RenderSettings(accuracy_target=target, **numbers))


def test_plan_without_a_target_follows_the_settings_and_measures_nothing() -> None:
    measurement = FakeCostMeasurement()
    planner = measurement.create_planner(default=TRACE)
    choice = planner.choose_plan(camera_spec(samples=3), CAMERA_STATES)
    assert (choice.plan.samples, choice.plan.renderer, choice.plan.reason) == (
        3,
        TRACE,
        "test; trace",
    )
    assert choice.bound is not None
    assert (
        choice.predicted_ms,
        choice.more_accurate,
        measurement.measured_kinds,
        measurement.created,
    ) == (
        None,
        None,
        [],
        [],
    )


def test_target_measures_every_renderer_once() -> None:
    measurement = FakeCostMeasurement()
    planner = measurement.create_planner()
    coarse, fine = (
        planner.choose_plan(camera_spec(AccuracyTarget(px)), CAMERA_STATES) for px in (2.0, 0.1)
    )
    assert measurement.measured_kinds == [TRACE, RASTER]
    assert coarse.plan.renderer is RASTER
    assert (fine.plan.renderer, fine.plan.samples, fine.predicted_ms) == (
        TRACE,
        8,
        pytest.approx(320.0),
    )


def test_target_measures_rays_alone_where_no_graphics_processor_draws() -> None:
    measurement = FakeCostMeasurement()
    planner = measurement.create_planner(default=TRACE)
    target = AccuracyTarget(2.0)
    assert planner.choose_plan(camera_spec(target), CAMERA_STATES).plan.renderer is TRACE
    assert (measurement.measured_kinds, measurement.created) == ([TRACE], [])
    named = planner.choose_plan(camera_spec(target, renderer="raster"), CAMERA_STATES)
    assert named.plan.renderer is RASTER


def test_settings_are_ignored_with_a_target() -> None:
    choice = (
        FakeCostMeasurement()
        .create_planner()
        .choose_plan(camera_spec(AccuracyTarget(0.1), samples=3), CAMERA_STATES)
    )
    assert choice.plan.samples == 8


def test_renderer_that_cannot_be_created_is_no_candidate() -> None:
    class Absent(FakeCostMeasurement):
        def create_raster(self) -> Any:
            raise RendererUnavailableError("no OpenGL", "install it")

    measurement = Absent()
    assert (
        measurement.create_planner()
        .choose_plan(camera_spec(AccuracyTarget(2.0)), CAMERA_STATES)
        .plan.renderer
        is TRACE
    )
    assert measurement.measured_kinds == [TRACE]


def test_stored_costs_are_not_measured_again(tmp_path: Path) -> None:
    cache = CostCache(tmp_path, build_scene(make_test_world()))
    first, second = FakeCostMeasurement(), FakeCostMeasurement()
    chosen = [
        measurement.create_planner(cache).choose_plan(
            camera_spec(AccuracyTarget(0.4)), CAMERA_STATES
        )
        for measurement in (first, second)
    ]
    assert (first.measured_kinds, second.measured_kinds) == ([TRACE, RASTER], [])
    assert chosen[0].plan == chosen[1].plan


def test_frames_twice_as_slow_double_the_predictions_of_that_renderer() -> None:
    planner = FakeCostMeasurement().create_planner()
    camera = camera_spec(AccuracyTarget(0.1))
    plan = planner.choose_plan(camera, CAMERA_STATES).plan
    assert (plan.renderer, plan.samples) == (TRACE, 8)
    assert planner.predict_frame_ms(camera, plan) == pytest.approx(320.0)
    planner.update_correction(camera, plan, 640.0)
    assert planner.predict_frame_ms(camera, plan) == pytest.approx(640.0)
    assert (
        planner.predict_frame_ms(
            OmniCameraSpec(make_omni_camera(width_px=99), RenderSettings()), plan
        )
        is None
    )


def test_target_without_an_error_bound_falls_back_to_the_settings_and_reports_so() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03))
    settings = RenderSettings(Tessellation(8, 8), accuracy_target=AccuracyTarget(0.5))
    choice = (
        FakeCostMeasurement()
        .create_planner()
        .choose_plan(OmniCameraSpec(camera, settings), CAMERA_STATES)
    )
    assert (choice.bound, choice.target_met) == (None, False)
    assert "no bound" in choice.plan.reason


def test_close_closes_all_created_renderers() -> None:
    measurement = FakeCostMeasurement()
    planner = measurement.create_planner()
    planner.choose_plan(camera_spec(AccuracyTarget(2.0)), CAMERA_STATES)
    planner.close()
    assert [renderer.closed for renderer in measurement.created] == [True]


def test_candidates_are_bounded_once_for_all_targets_of_a_camera(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planner = FakeCostMeasurement().create_planner()
    first = planner.choose_plan(camera_spec(AccuracyTarget(budget_ms=5.0)), CAMERA_STATES)

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("candidates, bounds of candidates and costs do not depend on targets")

    for module, name in (
        (candidate_table, "generate_candidate_plans"),
        (candidate_table, "error_bound"),
        (explicit_choice, "plan_from_settings"),
    ):
        monkeypatch.setattr(module, name, refuse)
    budgets = [planner.choose_plan(camera_spec(AccuracyTarget(budget_ms=ms)), CAMERA_STATES)
               for ms in (0.5, 5.0, 500.0)]  # fmt: skip
    assert budgets[1] == first
    assert len({choice.plan for choice in budgets}) == 3


def test_corrections_change_the_choice_without_new_bounds() -> None:
    planner = FakeCostMeasurement().create_planner()
    camera = camera_spec(AccuracyTarget(budget_ms=20.0))
    before = planner.choose_plan(camera, CAMERA_STATES)
    planner.update_correction(camera, before.plan, 4.0 * (before.predicted_ms or 0.0))
    after = planner.choose_plan(camera, CAMERA_STATES)
    assert before.plan != after.plan
    assert after.bound is not None
    assert before.bound is not None
    assert after.bound.outline_error_px > before.bound.outline_error_px


def test_cameras_with_costs_are_limited() -> None:
    measurement = FakeCostMeasurement()
    planner = measurement.create_planner()
    for width_px in (*range(40, 60), 59, 40):
        camera = make_omni_camera(width_px=width_px)
        settings = RenderSettings(accuracy_target=AccuracyTarget(1.0))
        planner.choose_plan(OmniCameraSpec(camera, settings), CAMERA_STATES)
    # The last camera is still known, the first one of 20 is not.
    assert measurement.measured_kinds == 21 * [TRACE, RASTER]


def test_renderer_that_fails_in_a_measurement_is_no_candidate_and_made_anew() -> None:
    class Failing(FakeCostMeasurement):
        def __call__(
            self, renderer: Renderer, kind: RendererKind, *others: Any
        ) -> list[PlanTiming]:
            if kind is RASTER:
                raise RuntimeError("lost device")
            return super().__call__(renderer, kind, *others)

    measurement = Failing()
    planner = measurement.create_planner()
    for _ in range(2):
        choice = planner.choose_plan(camera_spec(AccuracyTarget(2.0)), CAMERA_STATES)
        assert choice.plan.renderer is TRACE
    assert [renderer.closed for renderer in measurement.created] == [True]
    planner.renderers.get(RASTER)
    assert len(measurement.created) == 2


def test_plan_names_the_renderer_that_was_replaced() -> None:
    planner = FakeCostMeasurement().create_planner()
    planner.renderers.replace(RASTER, TRACE)
    choice = planner.choose_plan(camera_spec(AccuracyTarget(2.0)), CAMERA_STATES)
    assert choice.plan.renderer is TRACE
    assert choice.plan.reason.endswith("; trace in place of raster, which failed; trace")


def test_times_of_a_choice_follow_the_drawn_frames() -> None:
    planner = FakeCostMeasurement().create_planner()
    camera = camera_spec(AccuracyTarget(budget_ms=20.0))
    before = planner.choose_plan(camera, CAMERA_STATES)
    assert before.predicted_ms is not None
    assert planner.update_times(camera, before) == before
    planner.update_correction(camera, before.plan, 2.0 * before.predicted_ms + 3.0, added_ms=3.0)
    after = planner.update_times(camera, before)
    assert after.predicted_ms == pytest.approx(2.0 * before.predicted_ms + 3.0)
    assert after.faster is not None
    assert before.faster is not None
    # The renderer's factor is its own, effects count for every renderer.
    factor = 2.0 if before.faster.plan.renderer is before.plan.renderer else 1.0
    assert after.faster.predicted_ms == pytest.approx(factor * before.faster.predicted_ms + 3.0)


def test_times_of_a_choice_without_costs_stay_unknown() -> None:
    planner = FakeCostMeasurement().create_planner()
    choice = planner.choose_plan(camera_spec(), CAMERA_STATES)
    assert planner.update_times(camera_spec(), choice) is choice
    assert planner.added_ms(camera_spec(), choice.plan, {"Fog": 1.0}) == 0.0


def test_stages_without_rates_are_added() -> None:
    planner = FakeCostMeasurement().create_planner()
    camera = camera_spec(AccuracyTarget(1.0))
    plan = planner.choose_plan(camera, CAMERA_STATES).plan
    assert planner.added_ms(camera, plan, {"raster": 5.0, "Fog": 1.0, "encode": 0.5}) == 1.5


def test_requested_renderer_draws() -> None:
    planner = FakeCostMeasurement().create_planner()
    choice = planner.choose_plan(camera_spec(renderer="raster"), CAMERA_STATES)
    assert choice.plan.renderer is RASTER
    assert choice.plan.reason == "as requested; raster"


def test_requested_renderer_limits_the_candidates_of_a_target() -> None:
    planner = FakeCostMeasurement().create_planner()
    target = AccuracyTarget(2.0)
    assert planner.choose_plan(camera_spec(target), CAMERA_STATES).plan.renderer is RASTER
    choice = planner.choose_plan(camera_spec(target, renderer="trace"), CAMERA_STATES)
    assert choice.plan.renderer is TRACE
    neighbours = [one.plan.renderer for one in (choice.faster, choice.more_accurate) if one]
    assert set(neighbours) == {TRACE}
