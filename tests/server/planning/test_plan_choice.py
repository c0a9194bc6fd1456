"""Plan choice with invented costs: plan, reason and neighbours."""

from __future__ import annotations

import itertools

import pytest

from catoptra_server.frames.plan.candidates import generate_candidate_plans
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.plans import PlanChoice, PlanOption, choose_plan, pareto_front
from catoptra_server.render.render_settings import AccuracyTarget, PerPixel
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
KINDS = tuple(RendererKind)


class FakeCostPredictor:
    """Costs a sample and a million texels."""

    def __init__(self, *, trace_ms: float = 5.0, raster_ms: float = 5.0) -> None:
        self._trace_ms, self._raster_ms = trace_ms, raster_ms

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        if plan.renderer is RendererKind.TRACE:
            return self._trace_ms * plan.samples**2
        texels = sum(part.num_texels for part in plan.face_regions) * plan.face_samples
        return self._raster_ms * (plan.samples**2 / 4 + 1e-6 * texels)


def make_front(costs: FakeCostPredictor) -> tuple[PlanOption, ...]:
    plans = generate_candidate_plans(PerPixel(), CAMERA, KINDS)
    return pareto_front(
        PlanOption(plan, error_bound(CAMERA, plan).outline_error_px, costs.predict_frame_ms(plan))
        for plan in plans
    )


def choose_for(target: AccuracyTarget, costs: FakeCostPredictor | None = None) -> PlanChoice:
    return choose_plan(CAMERA, make_front(costs or FakeCostPredictor()), target)


def test_pareto_front_rises_in_cost_and_accuracy() -> None:
    steps = make_front(FakeCostPredictor())
    assert len(steps) > 8
    for lower, higher in itertools.pairwise(steps):
        assert lower.predicted_ms < higher.predicted_ms
        assert lower.error_bound_px > higher.error_bound_px


@pytest.mark.parametrize(("tolerance_px", "samples"), [(2.0, 1), (0.5, 2), (0.1, 8)])
def test_reachable_tolerance_takes_the_cheapest_plan_within(
    tolerance_px: float, samples: int
) -> None:
    choice = choose_for(AccuracyTarget(max_error_px=tolerance_px), FakeCostPredictor(raster_ms=1e3))
    assert choice.target_met
    assert choice.bound is not None
    assert choice.bound.outline_error_px <= tolerance_px
    assert (choice.plan.renderer, choice.plan.samples) == (RendererKind.TRACE, samples)
    assert choice.faster is None or choice.faster.error_bound_px > tolerance_px
    assert f"within {tolerance_px:g} px" in choice.plan.reason


def test_unreachable_tolerance_takes_the_most_accurate_plan_and_reports_so() -> None:
    choice = choose_for(AccuracyTarget(max_error_px=0.01))
    assert not choice.target_met
    assert choice.plan.samples == 8
    assert choice.more_accurate is None
    assert choice.plan.reason == "no plan stays within 0.01 px: the most accurate has 0.0884 px"


def test_budget_takes_the_most_accurate_plan_within() -> None:
    choice = choose_for(AccuracyTarget(budget_ms=21.0))
    assert choice.target_met
    assert choice.predicted_ms == 20.0
    assert choice.more_accurate is not None
    assert choice.more_accurate.predicted_ms > 21.0
    assert choice.plan.reason.startswith("the most accurate within 21 ms")


def test_too_small_budget_takes_the_cheapest_plan_and_reports_so() -> None:
    choice = choose_for(AccuracyTarget(budget_ms=0.1))
    assert not choice.target_met
    assert choice.faster is None
    assert choice.plan.reason.startswith("no plan fits into 0.1 ms: the cheapest takes about ")


def test_tolerance_within_the_budget_is_as_cheap_as_without_a_budget() -> None:
    both, alone = choose_for(AccuracyTarget(0.5, 30.0)), choose_for(AccuracyTarget(0.5))
    assert both.plan.description == alone.plan.description
    assert both.target_met


def test_tolerance_beyond_the_budget_yields_to_the_budget_and_reports_so() -> None:
    choice = choose_for(AccuracyTarget(0.1, 30.0))
    assert not choice.target_met
    assert choice.predicted_ms is not None
    assert choice.predicted_ms <= 30.0
    assert choice.plan.reason.startswith("0.1 px is out of reach in that time, the most accurate")


@pytest.mark.parametrize(
    ("costs", "kind"),
    [
        (FakeCostPredictor(trace_ms=1.0, raster_ms=100.0), RendererKind.TRACE),
        (FakeCostPredictor(trace_ms=100.0, raster_ms=0.1), RendererKind.RASTER),
    ],
)
def test_choice_takes_the_faster_renderer(costs: FakeCostPredictor, kind: RendererKind) -> None:
    assert choose_for(AccuracyTarget(max_error_px=2.0), costs).plan.renderer is kind


def test_choice_when_printed_has_time_and_neighbours() -> None:
    text = str(choose_for(AccuracyTarget(budget_ms=21.0)))
    assert "about 20.0 ms a frame" in text
    assert "next better trace" in text
    assert "next cheaper " in text
