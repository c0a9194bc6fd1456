"""Plans of cameras: chosen once, published with their bounds, and chosen again by frame times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

import pytest

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.frames.camera_plans import CameraPlans, ErrorBoundTable
from catoptra_server.planning.budget_monitor import BudgetStatus
from catoptra_server.planning.camera_spec import OmniCameraSpec, PerspectiveCameraSpec
from catoptra_server.planning.candidate_plans import generate_calibration_plans
from catoptra_server.planning.cost_model import PlanTiming
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import AccuracyTarget, MirrorSurface
from helpers.robots import CAMERA


class Renderer:
    """A renderer that is described, and draws nothing."""

    def describe(self) -> str:
        return "test renderer"

    def close(self) -> None:
        pass


def make_plans(published: ErrorBoundTable | None = None) -> CameraPlans:
    """Plans by a renderer that was measured at 1 ms a sample."""

    def measure(
        renderer: object, kind: RendererKind, camera: OmniCamera, surface: MirrorSurface, *_: object
    ) -> list[PlanTiming]:
        plans = generate_calibration_plans(kind, camera, surface)
        return [PlanTiming(plan, {"trace": 1.0 * plan.samples**2}) for plan in plans]

    choice = RendererChoice(Renderer(), RendererKind.TRACE, "test")  # type: ignore[arg-type] # enough of one
    planner = RenderPlanner(RendererPool(choice), measure=measure)
    return CameraPlans(planner, error_bounds=published)


def make_spec(budget_ms: float = 0.0, max_error_px: float = 0.0) -> OmniCameraSpec:
    target = AccuracyTarget(budget_ms=budget_ms, max_error_px=max_error_px)
    return OmniCameraSpec(CAMERA.camera, replace(CAMERA.render_settings, accuracy_target=target))


BUDGETED = make_spec(10.0)


def draw_frames(
    plans: CameraPlans, ms_per_sample: float, frames: int, spec: OmniCameraSpec = BUDGETED
) -> list[int]:
    """Samples of the plans of some frames, one entry a change."""
    samples: list[int] = []
    for _ in range(frames):
        planned = plans.find(spec)
        plans.replan_if_due(planned)
        samples.append(planned.plan.samples)
        ms = ms_per_sample * planned.plan.samples**2
        plans.record_frame(planned, ms, {"trace": ms})
    return [number for number, _ in groupby(samples)]


def test_budget_when_met_leaves_the_plan_alone() -> None:
    assert draw_frames(make_plans(), 1.0, 1000) == [3]


def test_budget_when_exceeded_replans_and_logs_why(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        assert draw_frames(make_plans(), 2.0, 1000) == [3, 2]
    assert "18.0 ms a frame (median), budget 10 ms: too slow" in caplog.text


def test_budget_when_unreachable_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"):
        assert draw_frames(make_plans(), 50.0, 1000) == [3, 1]
    assert caplog.text.count("no better plan") == 1


def test_budget_when_frames_become_fast_again_is_used_fully() -> None:
    plans = make_plans()
    assert draw_frames(plans, 2.0, 100) == [3, 2]
    assert draw_frames(plans, 0.9, 1000) == [2, 3]


@pytest.mark.parametrize("spec", [make_spec(), BUDGETED])
def test_plan_without_a_reason_to_change_is_kept(spec: OmniCameraSpec) -> None:
    plans = make_plans()
    draw_frames(plans, 1.0, 40, spec)
    planned = plans.find(spec)
    plan, text = planned.plan, planned.plan_text
    assert planned.budget_status is BudgetStatus.WITHIN_BUDGET
    plans.replan_if_due(planned)
    assert (planned.plan, planned.plan_text) == (plan, text)


def test_state_when_requested_adds_no_camera() -> None:
    published = ErrorBoundTable()
    plans = make_plans(published)
    state = plans.find_state(BUDGETED)
    assert (state.choice.plan.samples, state.median_ms) == (3, None)
    assert published.get(BUDGETED) is None
    draw_frames(plans, 1.0, 30)
    assert plans.find_state(BUDGETED).median_ms == pytest.approx(9.0)


def test_state_predicts_what_drawn_frames_took() -> None:
    plans, spec = make_plans(), make_spec(15.0)
    assert plans.find_state(spec).choice.predicted_ms == pytest.approx(9.0)
    draw_frames(plans, 1.5, 30, spec)
    state = plans.find_state(spec)
    assert state.choice.predicted_ms == pytest.approx(state.median_ms) == pytest.approx(13.5)
    assert state.choice.faster is not None
    assert state.choice.faster.predicted_ms == pytest.approx(6.0)


def known_bounds(published: ErrorBoundTable, specs: Sequence[OmniCameraSpec]) -> list[bool]:
    return [published.get(spec) is not None for spec in specs]


def test_cameras_when_forgotten_are_planned_anew_and_have_no_published_bound() -> None:
    published = ErrorBoundTable()
    plans, specs = make_plans(published), (BUDGETED, make_spec(20.0))
    planned = [plans.find(spec) for spec in specs]
    assert known_bounds(published, specs) == [True, True]
    plans.forget_all()
    assert known_bounds(published, specs) == [False, False]
    assert plans.find(specs[0]) is not planned[0]


def test_cameras_are_limited_and_so_are_published_bounds() -> None:
    published = ErrorBoundTable()
    plans = make_plans(published)
    specs = [make_spec(max_error_px=1.0 + 0.001 * n) for n in range(300)]
    for spec in specs:
        plans.find(spec)
    assert known_bounds(published, specs) == 44 * [False] + 256 * [True]


def test_perspective_camera_has_the_plan_of_the_preferred_renderer() -> None:
    planned = make_plans().find(PerspectiveCameraSpec(PerspectiveCamera(20, 10, 1.0)))
    assert planned.plan.renderer is RendererKind.TRACE
    assert (planned.choice, planned.bounds) == (None, None)
