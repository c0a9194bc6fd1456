"""Choice of a plan for an accuracy target: the cheapest within a tolerance, the best in a budget.

Every candidate has an error bound, `ErrorBound.outline_error_px`, and a predicted time. Candidates
that another one beats in both are dropped; the others form a Pareto front, from the cheapest to the
most accurate. A choice is a point of the front and names both neighbours, so that a client
sees the price of a little more accuracy, and the gain of a little less.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.planning.error_bound import ErrorBound, error_bound
from catoptra_server.render.render_settings import AccuracyTarget
from catoptra_server.render.renderer import RenderPlan


@dataclass(frozen=True, slots=True)
class PlanOption:
    """Candidate plan with error bound and predicted cost."""

    plan: RenderPlan
    error_bound_px: float
    """Largest displacement of an outline."""
    predicted_ms: float

    def __str__(self) -> str:
        numbers = f"{self.error_bound_px:.3g} px in {self.predicted_ms:.1f} ms"
        return f"{self.plan.description}: {numbers}"


@dataclass(frozen=True, slots=True)
class PlanChoice:
    """Plan of a camera, with its bound and its neighbours on the Pareto front."""

    plan: RenderPlan
    bound: ErrorBound | None
    """None for a plan whose error has no bound: a mesh under an orthographic camera."""
    predicted_ms: float | None = None
    """None without an accuracy target: no cost is measured then."""
    target_met: bool = True
    """Whether the plan meets the accuracy target."""
    more_accurate: PlanOption | None = None
    """Next more accurate option."""
    faster: PlanOption | None = None
    """Next cheaper option."""

    def __str__(self) -> str:
        cost = "" if self.predicted_ms is None else f"; about {self.predicted_ms:.1f} ms a frame"
        better = f"; next better {self.more_accurate}" if self.more_accurate else ""
        cheaper = f"; next cheaper {self.faster}" if self.faster else ""
        return f"{self.plan}{cost}{better}{cheaper}"


def pareto_front(options: Iterable[PlanOption]) -> tuple[PlanOption, ...]:
    """Options that no other beats in both error and cost, from the cheapest on."""
    front: list[PlanOption] = []
    # In order of cost, an option belongs to the front exactly if more accurate than all before.
    for option in sorted(options, key=lambda one: (one.predicted_ms, one.error_bound_px)):
        if not front or option.error_bound_px < front[-1].error_bound_px:
            front.append(option)
    return tuple(front)


def choose_plan(
    camera: OmniCamera, options: tuple[PlanOption, ...], target: AccuracyTarget
) -> PlanChoice:
    """Choose the option that meets a target, or the nearest to it.

    Args:
        options: A Pareto front, not empty.
    """
    index, target_met, reason = _choose_option(options, target)
    option = options[index]
    return PlanChoice(
        plan=replace(option.plan, reason=reason),
        bound=error_bound(camera, option.plan),
        predicted_ms=option.predicted_ms,
        target_met=target_met,
        more_accurate=options[index + 1] if index + 1 < len(options) else None,
        faster=options[index - 1] if index else None,
    )


_Selection = tuple[int, bool, str]  # index, whether the target is met, reason


def _choose_option(options: tuple[PlanOption, ...], target: AccuracyTarget) -> _Selection:
    tolerance_px, budget_ms = target.max_error_px, target.budget_ms
    # The first within the tolerance is the cheapest: costs grow along the front.
    in_tolerance = next(
        (i for i, option in enumerate(options) if option.error_bound_px <= tolerance_px), None
    )
    if not budget_ms:
        return _choose_by_tolerance(options, tolerance_px, in_tolerance)
    in_budget = [i for i, option in enumerate(options) if option.predicted_ms <= budget_ms]
    if in_tolerance is not None and in_tolerance in in_budget:
        return in_tolerance, True, f"the cheapest within {tolerance_px:g} px, in {budget_ms:g} ms"
    # In conflict the budget wins over the tolerance, as AccuracyTarget documents.
    conflict = f"{tolerance_px:g} px is out of reach in that time, " if tolerance_px else ""
    if not in_budget:
        cheapest = f"the cheapest takes about {options[0].predicted_ms:.1f} ms"
        return 0, False, f"{conflict}no plan fits into {budget_ms:g} ms: {cheapest}"
    best = in_budget[-1]
    reason = f"the most accurate within {budget_ms:g} ms, {options[best].error_bound_px:.3g} px"
    return best, not tolerance_px, f"{conflict}{reason}"


def _choose_by_tolerance(
    options: tuple[PlanOption, ...], tolerance_px: float, in_tolerance: int | None
) -> _Selection:
    if in_tolerance is not None:
        bound_px = options[in_tolerance].error_bound_px
        return in_tolerance, True, f"the cheapest within {tolerance_px:g} px, {bound_px:.3g} px"
    last = len(options) - 1
    best = f"the most accurate has {options[last].error_bound_px:.3g} px"
    return last, False, f"no plan stays within {tolerance_px:g} px: {best}"
