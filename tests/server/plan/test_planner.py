"""The planner with costs that are made up: what it takes, what it says, what its neighbours are."""

from __future__ import annotations

import itertools

import pytest

from catoptra_server.plan.candidates import candidates
from catoptra_server.plan.planner import Option, PlanChoice, choose, ladder
from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderPlan
from catoptra_server.robot.render_wish import Dial
from helpers.worlds import omni_camera

CAMERA = omni_camera(width_px=360)
KINDS = tuple(RendererKind)


class FakeCosts:
    """So many ms a sample and a million texels; rays apart cost half of all rays."""

    def __init__(self, *, trace_ms: float = 5.0, raster_ms: float = 5.0) -> None:
        self._trace_ms, self._raster_ms = trace_ms, raster_ms

    def ms(self, plan: RenderPlan) -> float:
        if plan.renderer is RendererKind.TRACE:
            return self._trace_ms * plan.samples**2 * (1.0 if plan.stride_px > 1 else 2.0)
        texels = sum(part.texels for part in plan.face_parts) * plan.face_samples
        return self._raster_ms * (plan.samples**2 / 4 + 1e-6 * texels)


def steps_of(costs: FakeCosts) -> tuple[Option, ...]:
    return ladder(CAMERA, candidates(PerPixel(), CAMERA, KINDS), costs)


def chosen(dial: Dial, costs: FakeCosts | None = None) -> PlanChoice:
    return choose(CAMERA, steps_of(costs or FakeCosts()), dial)


def test_ladder_when_climbed_costs_more_and_shows_better_at_each_step() -> None:
    steps = steps_of(FakeCosts())
    assert len(steps) > 8
    for lower, higher in itertools.pairwise(steps):
        assert lower.ms < higher.ms
        assert lower.error_px > higher.error_px


@pytest.mark.parametrize(("tolerance_px", "samples"), [(2.0, 1), (0.5, 2), (0.1, 8)])
def test_tolerance_when_it_can_be_kept_takes_the_cheapest_that_keeps_it(
    tolerance_px: float, samples: int
) -> None:
    choice = chosen(Dial(max_error_px=tolerance_px), FakeCosts(raster_ms=1e3))
    assert choice.keeps_word
    assert choice.bound is not None
    assert choice.bound.outline_px <= tolerance_px
    assert (choice.plan.renderer, choice.plan.samples) == (RendererKind.TRACE, samples)
    assert choice.cheaper is None or choice.cheaper.error_px > tolerance_px
    assert f"within {tolerance_px:g} px" in choice.plan.reason


def test_tolerance_when_no_plan_keeps_it_takes_the_best_and_says_so() -> None:
    choice = chosen(Dial(max_error_px=0.01))
    assert not choice.keeps_word
    assert choice.plan.samples == 8
    assert choice.better is None
    assert choice.plan.reason == "no plan keeps 0.01 px: the best that can be is 0.0884 px"


def test_budget_when_plans_fit_takes_the_most_accurate_of_them() -> None:
    choice = chosen(Dial(budget_ms=21.0))
    assert choice.keeps_word
    assert choice.ms == 20.0
    assert choice.better is not None
    assert choice.better.ms > 21.0
    assert choice.plan.reason.startswith("the most accurate within 21 ms")


def test_budget_when_nothing_fits_takes_the_cheapest_and_says_so() -> None:
    choice = chosen(Dial(budget_ms=0.1))
    assert not choice.keeps_word
    assert choice.cheaper is None
    assert choice.plan.reason.startswith("no plan fits into 0.1 ms: the cheapest, about ")


def test_tolerance_with_a_budget_when_both_can_be_kept_is_as_cheap_as_without() -> None:
    both, alone = chosen(Dial(0.5, 30.0)), chosen(Dial(0.5))
    assert both.plan.numbers == alone.plan.numbers
    assert both.keeps_word


def test_tolerance_with_a_budget_when_it_takes_too_long_keeps_the_budget_and_says_so() -> None:
    choice = chosen(Dial(0.1, 30.0))
    assert not choice.keeps_word
    assert choice.ms is not None
    assert choice.ms <= 30.0
    assert choice.plan.reason.startswith("0.1 px cannot be kept in that time, the most accurate")


@pytest.mark.parametrize(
    ("costs", "kind"),
    [
        (FakeCosts(trace_ms=1.0, raster_ms=100.0), RendererKind.TRACE),
        (FakeCosts(trace_ms=100.0, raster_ms=0.1), RendererKind.RASTER),
    ],
)
def test_renderer_when_another_is_slower_is_the_faster_one(
    costs: FakeCosts, kind: RendererKind
) -> None:
    assert chosen(Dial(max_error_px=2.0), costs).plan.renderer is kind


def test_choice_when_printed_tells_time_and_neighbours() -> None:
    text = str(chosen(Dial(budget_ms=21.0)))
    assert "about 20.0 ms a frame" in text
    assert "next better trace" in text
    assert "next cheaper " in text
