"""The planner: the cheapest plan that keeps a tolerance, or the most accurate within a budget.

Every possible plan has an error, `ErrorBound.outline_px`, and a predicted time. Those that another
plan beats in both are dropped; what is left is a ladder on which each step costs more and shows
better. A choice is a step, and knows its neighbours: what a little more or less would cost.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Protocol

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.plan.error_bound import ErrorBound, error_bound
from catoptra_server.plan.render_plan import RenderPlan
from catoptra_server.robot.render_wish import Dial


class Costs(Protocol):
    """What knows how long plans take."""

    def ms(self, plan: RenderPlan) -> float:
        """Return the predicted milliseconds of a frame."""


@dataclass(frozen=True, slots=True)
class Option:
    """A possible plan: how far off an outline may be, and how long a frame takes by prediction."""

    plan: RenderPlan
    error_px: float
    ms: float

    def __str__(self) -> str:
        return f"{self.plan.numbers}: {self.error_px:.3g} px in {self.ms:.1f} ms"


@dataclass(frozen=True, slots=True)
class PlanChoice:
    """A plan, its bound (None: it has none), and its neighbours on the ladder where it has any.

    ms: predicted; None where nobody asked what it costs. keeps_word: whether the dial is kept.
    """

    plan: RenderPlan
    bound: ErrorBound | None
    ms: float | None = None
    keeps_word: bool = True
    better: Option | None = None
    cheaper: Option | None = None

    def __str__(self) -> str:
        cost = "" if self.ms is None else f"; about {self.ms:.1f} ms a frame"
        better = f"; next better {self.better}" if self.better else ""
        cheaper = f"; next cheaper {self.cheaper}" if self.cheaper else ""
        return f"{self.plan}{cost}{better}{cheaper}"


def ladder(camera: OmniCamera, plans: Iterable[RenderPlan], costs: Costs) -> tuple[Option, ...]:
    """Return the options that nothing beats, from the cheapest to the most accurate."""
    options = [Option(p, error_bound(camera, p).outline_px, costs.ms(p)) for p in plans]
    steps: list[Option] = []
    for option in sorted(options, key=lambda one: (one.ms, one.error_px)):
        if not steps or option.error_px < steps[-1].error_px:
            steps.append(option)
    return tuple(steps)


def choose(camera: OmniCamera, steps: tuple[Option, ...], dial: Dial) -> PlanChoice:
    """Return the step that keeps a dial, with the reason in its plan; else the nearest to it."""
    index, keeps_word, reason = _index(steps, dial)
    step = steps[index]
    return PlanChoice(
        plan=replace(step.plan, reason=reason),
        bound=error_bound(camera, step.plan),
        ms=step.ms,
        keeps_word=keeps_word,
        better=steps[index + 1] if index + 1 < len(steps) else None,
        cheaper=steps[index - 1] if index else None,
    )


def _index(steps: tuple[Option, ...], dial: Dial) -> tuple[int, bool, str]:
    """Return which step it is, whether it keeps the dial, and why it was taken."""
    exact = next((i for i, s in enumerate(steps) if s.error_px <= dial.max_error_px), None)
    if not dial.budget_ms:
        return _by_tolerance(steps, dial, exact)
    fitting = [i for i, step in enumerate(steps) if step.ms <= dial.budget_ms]
    if exact is not None and exact in fitting:
        return (
            exact,
            True,
            f"the cheapest within {dial.max_error_px:g} px, in {dial.budget_ms:g} ms",
        )
    broken = f"{dial.max_error_px:g} px cannot be kept in that time, " if dial.max_error_px else ""
    if not fitting:
        least = f"the cheapest, about {steps[0].ms:.1f} ms"
        return 0, False, f"{broken}no plan fits into {dial.budget_ms:g} ms: {least}"
    kept = f"the most accurate within {dial.budget_ms:g} ms"
    return (
        fitting[-1],
        not dial.max_error_px,
        f"{broken}{kept}, {steps[fitting[-1]].error_px:.3g} px",
    )


def _by_tolerance(
    steps: tuple[Option, ...], dial: Dial, exact: int | None
) -> tuple[int, bool, str]:
    if exact is not None:
        kept = f"the cheapest within {dial.max_error_px:g} px"
        return exact, True, f"{kept}, {steps[exact].error_px:.3g} px"
    best = f"the best that can be is {steps[-1].error_px:.3g} px"
    return len(steps) - 1, False, f"no plan keeps {dial.max_error_px:g} px: {best}"
