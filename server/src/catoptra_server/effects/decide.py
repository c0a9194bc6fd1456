"""The decision before a frame: which effects the scene calls for, and why. Pure, and cached.

An effect's bound is that of what reaches it: those that run before it count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import cast

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.effect import (
    Bound,
    Criterion,
    Effect,
    EffectWishes,
    Mode,
    Wish,
)
from catoptra_server.effects.kept_bounds import KeptBounds
from catoptra_server.effects.scene_summary import SceneSummary

# So many decisions of an effect are kept: as many as bounds.
_TOLD = 512
_ROW = "{:<20} {:<4}{:>8} {:>10}  {:<12} {:>7}  {}"


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

    def bound(self, effect: str) -> float:
        """Return the bound of an effect by its name; 0 of what no file names."""
        return next((one.bound for one in self.decisions if one.effect == effect), 0.0)

    def __str__(self) -> str:
        return table(self.decisions, {})


NO_EFFECTS = EffectPlan()


@dataclass(frozen=True, slots=True, eq=False)
class _Considered:
    """A wish, what is known of its bounds, and whether it changes the scene, not the picture.

    told: the decisions that followed from bounds.
    """

    wish: Wish
    bounds: KeptBounds
    is_staged: bool
    told: dict[Bound, Decision] = field(default_factory=dict)


@lru_cache(maxsize=64)
def _considered(wishes: EffectWishes, camera: OmniCamera) -> tuple[_Considered, ...]:
    return tuple(
        _Considered(wish, KeptBounds(wish.effect, camera), not isinstance(wish.effect, Effect))
        for wish in wishes.wishes
    )


@lru_cache(maxsize=256)
def decide(wishes: EffectWishes, summary: SceneSummary, camera: OmniCamera) -> EffectPlan:
    """Return which effects run: `always`, or `auto` with a bound above the threshold.

    What one before it does as well is left out, whatever the robot's file says.
    """
    decisions: list[Decision] = []
    staged: list[Criterion] = []
    active: list[Criterion] = []
    for one in _considered(wishes, camera):
        effect = one.wish.effect
        threshold = wishes.threshold(effect.unit)
        decisions.append(_decision(one, summary, threshold))
        if decisions[-1].is_on:
            (staged if one.is_staged else active).append(effect)
            summary = effect.after(summary)
    return EffectPlan(tuple(decisions), tuple(staged), cast(tuple[Effect, ...], tuple(active)))


def _decision(one: _Considered, summary: SceneSummary, threshold: float) -> Decision:
    if one.wish.effect.name in summary.done:
        return replace(_told(one.wish, Bound(0.0, "it is done already"), threshold), is_on=False)
    bound = one.bounds.of(summary)
    known = one.told.get(bound)
    if known is None:
        if len(one.told) >= _TOLD:
            one.told.clear()
        known = one.told[bound] = _told(one.wish, bound, threshold)
    return known


def _told(wish: Wish, bound: Bound, threshold: float) -> Decision:
    is_on = {
        Mode.ALWAYS: True,
        Mode.NEVER: False,
        Mode.AUTO: bound.value > threshold,
    }[wish.mode]
    asked = "" if wish.mode is Mode.AUTO else f"{wish.mode.value} by the robot's file; "
    return Decision(
        effect=wish.effect.name,
        is_on=is_on,
        bound=bound.value,
        threshold=threshold,
        unit=wish.effect.unit,
        reason=f"{asked}{bound.reason}",
    )


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
