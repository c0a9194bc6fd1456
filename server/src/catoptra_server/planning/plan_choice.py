"""The planner: the cheapest plan that keeps a tolerance, or the most accurate within a budget.

Every possible plan has an error, `ErrorBound.outline_px`, and a predicted time. Those that another
plan beats in both are dropped; what is left is a ladder on which each step costs more and shows
better. A choice is a step, and knows its neighbours: what a little more or less would cost.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.error_bound import ErrorBound, error_bound
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.robot.render_settings import AccuracyTarget


class CostPredictor(Protocol):
    """What knows how long plans take."""

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        """Return the predicted milliseconds of a frame."""


@dataclass(frozen=True, slots=True)
class PlanOption:
    """A possible plan: how far off an outline may be, and how long a frame takes by prediction."""

    plan: RenderPlan
    error_bound_px: float
    predicted_ms: float

    def __str__(self) -> str:
        return (
            f"{self.plan.description}: {self.error_bound_px:.3g} px in {self.predicted_ms:.1f} ms"
        )


@dataclass(frozen=True, slots=True)
class PlanChoice:
    """A plan, its bound (None: it has none), and its neighbours on the ladder where it has any.

    ms: predicted; None where nobody asked what it costs. keeps_word: whether the dial is kept.
    """

    plan: RenderPlan
    bound: ErrorBound | None
    predicted_ms: float | None = None
    target_met: bool = True
    more_accurate: PlanOption | None = None
    faster: PlanOption | None = None

    def __str__(self) -> str:
        cost = "" if self.predicted_ms is None else f"; about {self.predicted_ms:.1f} ms a frame"
        better = f"; next better {self.more_accurate}" if self.more_accurate else ""
        cheaper = f"; next cheaper {self.faster}" if self.faster else ""
        return f"{self.plan}{cost}{better}{cheaper}"


def pareto_front(
    camera: OmniCamera, plans: Iterable[RenderPlan], costs: CostPredictor
) -> tuple[PlanOption, ...]:
    """Return the options that nothing beats, from the cheapest to the most accurate."""
    options = [
        PlanOption(p, error_bound(camera, p).outline_error_px, costs.predict_frame_ms(p))
        for p in plans
    ]
    steps: list[PlanOption] = []
    for option in sorted(options, key=lambda one: (one.predicted_ms, one.error_bound_px)):
        if not steps or option.error_bound_px < steps[-1].error_bound_px:
            steps.append(option)
    return tuple(steps)


def choose_plan(
    camera: OmniCamera, options: tuple[PlanOption, ...], target: AccuracyTarget
) -> PlanChoice:
    """Return the step that keeps a dial, with the reason in its plan; else the nearest to it."""
    index, keeps_word, reason = _choose_option(options, target)
    step = options[index]
    return PlanChoice(
        plan=replace(step.plan, reason=reason),
        bound=error_bound(camera, step.plan),
        predicted_ms=step.predicted_ms,
        target_met=keeps_word,
        more_accurate=options[index + 1] if index + 1 < len(options) else None,
        faster=options[index - 1] if index else None,
    )


def _choose_option(
    options: tuple[PlanOption, ...], target: AccuracyTarget
) -> tuple[int, bool, str]:
    """Return which step it is, whether it keeps the dial, and why it was taken."""
    exact = next(
        (i for i, s in enumerate(options) if s.error_bound_px <= target.max_error_px), None
    )
    if not target.budget_ms:
        return _choose_by_tolerance(options, target, exact)
    fitting = [i for i, step in enumerate(options) if step.predicted_ms <= target.budget_ms]
    if exact is not None and exact in fitting:
        return (
            exact,
            True,
            f"the cheapest within {target.max_error_px:g} px, in {target.budget_ms:g} ms",
        )
    broken = (
        f"{target.max_error_px:g} px cannot be kept in that time, " if target.max_error_px else ""
    )
    if not fitting:
        least = f"the cheapest, about {options[0].predicted_ms:.1f} ms"
        return 0, False, f"{broken}no plan fits into {target.budget_ms:g} ms: {least}"
    kept = f"the most accurate within {target.budget_ms:g} ms"
    return (
        fitting[-1],
        not target.max_error_px,
        f"{broken}{kept}, {options[fitting[-1]].error_bound_px:.3g} px",
    )


def _choose_by_tolerance(
    options: tuple[PlanOption, ...], target: AccuracyTarget, index_in_tolerance: int | None
) -> tuple[int, bool, str]:
    if index_in_tolerance is not None:
        kept = f"the cheapest within {target.max_error_px:g} px"
        return (
            index_in_tolerance,
            True,
            f"{kept}, {options[index_in_tolerance].error_bound_px:.3g} px",
        )
    best = f"the best that can be is {options[-1].error_bound_px:.3g} px"
    return len(options) - 1, False, f"no plan keeps {target.max_error_px:g} px: {best}"
