"""The decision before a frame: which effects the scene calls for, and why. Pure, and cached.

An effect's bound is that of what reaches it: those that run before it count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.effect import (
    Bound,
    Criterion,
    Effect,
    EffectWishes,
    Mode,
    Wish,
    asks_for_more_than_light,
)
from catoptra_server.effects.scene_summary import SceneSummary

_ROW = "{:<17} {:<4}{:>8} {:>10}  {:<12} {:>7}  {}"


@dataclass(frozen=True, slots=True)
class Decision:
    """Whether an effect runs, the most that it can change any pixel, and the words for it."""

    effect: str
    is_on: bool
    bound: float
    threshold: float
    unit: str
    reason: str


@dataclass(frozen=True, slots=True)
class EffectPlan:
    """The decisions on all effects that a robot's file names, and those that run, in order.

    staged: what changes the scene. active: what changes the picture.
    """

    decisions: tuple[Decision, ...] = ()
    staged: tuple[Criterion, ...] = ()
    active: tuple[Effect, ...] = ()

    @property
    def running(self) -> tuple[Criterion, ...]:
        """Return what changes the scene, then what changes the picture."""
        return (*self.staged, *self.active)

    def __str__(self) -> str:
        return table(self.decisions, {})


NO_EFFECTS = EffectPlan()


@lru_cache(maxsize=64)
def decide(wishes: EffectWishes, summary: SceneSummary, camera: OmniCamera) -> EffectPlan:
    """Return which effects run: `always`, or `auto` with a bound above the threshold.

    What one before it does as well is left out, whatever the robot's file says.
    """
    decisions: list[Decision] = []
    running: list[Criterion] = []
    for wish in wishes.wishes:
        threshold = wishes.threshold(wish.effect.unit)
        decisions.append(_decision(wish, summary, camera, threshold=threshold))
        if decisions[-1].is_on:
            running.append(wish.effect)
            summary = wish.effect.after(summary)
    return EffectPlan(
        tuple(decisions),
        staged=tuple(effect for effect in running if not isinstance(effect, Effect)),
        active=tuple(effect for effect in running if isinstance(effect, Effect)),
    )


def _decision(
    wish: Wish, summary: SceneSummary, camera: OmniCamera, *, threshold: float
) -> Decision:
    effect = wish.effect
    is_done = effect.name in summary.done
    bound = Bound(0.0, "it is done already") if is_done else _bound(effect, summary, camera)
    wanted = {
        Mode.ALWAYS: True,
        Mode.NEVER: False,
        Mode.AUTO: bound.value > threshold,
    }[wish.mode]
    asked = "" if wish.mode is Mode.AUTO else f"{wish.mode.value} by the robot's file; "
    return Decision(
        effect=effect.name,
        is_on=wanted and not is_done,
        bound=bound.value,
        threshold=threshold,
        unit=effect.unit,
        reason=f"{asked}{bound.reason}",
    )


def _bound(effect: Criterion, summary: SceneSummary, camera: OmniCamera) -> Bound:
    if not asks_for_more_than_light(effect):
        summary = SceneSummary(summary.largest_radiance)
    return _found_bound(effect, summary, camera)


@lru_cache(maxsize=512)
def _found_bound(effect: Criterion, summary: SceneSummary, camera: OmniCamera) -> Bound:
    """Return a bound: found once, not anew with every step of a robot that moves."""
    return effect.bound(summary, camera)


def table(decisions: Sequence[Decision], ms: Mapping[str, float]) -> str:
    """Return decisions as a table with a row each; ms: what those that run take, where known."""
    if not decisions:
        return "no effects: the robot's file names none"
    head = _ROW.format("effect", "", "bound", "threshold", "unit", "ms", "reason")
    return "\n".join((head, *(_row(decision, ms.get(decision.effect)) for decision in decisions)))


def _row(decision: Decision, ms: float | None) -> str:
    state = "on" if decision.is_on else "off"
    numbers = (f"{decision.bound:.3g}", f"{decision.threshold:.3g}")
    taken = "" if ms is None else f"{ms:.1f}"
    return _ROW.format(decision.effect, state, *numbers, decision.unit, taken, decision.reason)
