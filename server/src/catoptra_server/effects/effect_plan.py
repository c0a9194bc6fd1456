"""The decision before a frame: which effects the scene calls for, and why. Pure, and cached.

An effect's bound is that of what reaches it: those that run before it count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import cast

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.bound_cache import BoundCache
from catoptra_server.effects.effect import (
    Effect,
    EffectBound,
    EffectMode,
    EffectSetting,
    EffectSettings,
    ImageEffect,
)
from catoptra_server.effects.scene_summary import SceneSummary

# So many decisions of an effect are kept: as many as bounds.
_MAX_CACHED_DECISIONS = 512
_ROW_FORMAT = "{:<20} {:<4}{:>8} {:>10}  {:<12} {:>7}  {}"


@dataclass(frozen=True, slots=True)
class EffectDecision:
    """Whether an effect runs, the most that it can change any pixel, and the words for it."""

    effect: str
    enabled: bool
    bound: float
    threshold: float
    unit: str
    reason: str


@dataclass(frozen=True, slots=True)
class EffectPlan:
    """The decisions on all effects that a robot's file names, and those that run, in order.

    staged: what changes the scene. active: what changes the picture.
    """

    decisions: tuple[EffectDecision, ...] = ()
    scene_effects: tuple[Effect, ...] = ()
    image_effects: tuple[ImageEffect, ...] = ()

    @property
    def enabled_effects(self) -> tuple[Effect, ...]:
        """Return what changes the scene, then what changes the picture."""
        return (*self.scene_effects, *self.image_effects)

    def find_bound(self, effect_name: str) -> float:
        """Return the bound of an effect by its name; 0 of what no file names."""
        return next((one.bound for one in self.decisions if one.effect == effect_name), 0.0)

    def __str__(self) -> str:
        return format_decisions(self.decisions, {})


NO_EFFECTS = EffectPlan()


@dataclass(frozen=True, slots=True, eq=False)
class _EffectEntry:
    """A wish, what is known of its bounds, and whether it changes the scene, not the picture.

    told: the decisions that followed from bounds.
    """

    setting: EffectSetting
    bound_cache: BoundCache
    is_scene_effect: bool
    decisions: dict[EffectBound, EffectDecision] = field(default_factory=dict)


@lru_cache(maxsize=64)
def _effect_entries(settings: EffectSettings, camera: OmniCamera) -> tuple[_EffectEntry, ...]:
    return tuple(
        _EffectEntry(
            wish, BoundCache(wish.effect, camera), not isinstance(wish.effect, ImageEffect)
        )
        for wish in settings.settings
    )


@lru_cache(maxsize=256)
def plan_effects(settings: EffectSettings, summary: SceneSummary, camera: OmniCamera) -> EffectPlan:
    """Return which effects run: `always`, or `auto` with a bound above the threshold.

    What one before it does as well is left out, whatever the robot's file says.
    """
    decisions: list[EffectDecision] = []
    staged: list[Effect] = []
    active: list[Effect] = []
    for one in _effect_entries(settings, camera):
        effect = one.setting.effect
        threshold = settings.threshold(effect.unit)
        decisions.append(_find_decision(one, summary, threshold))
        if decisions[-1].enabled:
            (staged if one.is_scene_effect else active).append(effect)
            summary = effect.update_summary(summary)
    return EffectPlan(tuple(decisions), tuple(staged), cast(tuple[ImageEffect, ...], tuple(active)))


def _find_decision(entry: _EffectEntry, summary: SceneSummary, threshold: float) -> EffectDecision:
    if entry.setting.effect.name in summary.superseded_effects:
        return replace(
            _decide(entry.setting, EffectBound(0.0, "it is done already"), threshold), enabled=False
        )
    bound = entry.bound_cache.get(summary)
    known = entry.decisions.get(bound)
    if known is None:
        if len(entry.decisions) >= _MAX_CACHED_DECISIONS:
            entry.decisions.clear()
        known = entry.decisions[bound] = _decide(entry.setting, bound, threshold)
    return known


def _decide(setting: EffectSetting, bound: EffectBound, threshold: float) -> EffectDecision:
    is_on = {
        EffectMode.ALWAYS: True,
        EffectMode.NEVER: False,
        EffectMode.AUTO: bound.value > threshold,
    }[setting.mode]
    asked = "" if setting.mode is EffectMode.AUTO else f"{setting.mode.value} by the robot's file; "
    return EffectDecision(
        effect=setting.effect.name,
        enabled=is_on,
        bound=bound.value,
        threshold=threshold,
        unit=setting.effect.unit,
        reason=f"{asked}{bound.reason}",
    )


def format_decisions(decisions: Sequence[EffectDecision], ms: Mapping[str, float]) -> str:
    """Return decisions as a table with a row each; ms: what those that run take, where known."""
    if not decisions:
        return "no effects: the robot's file names none"
    head = _ROW_FORMAT.format("effect", "", "bound", "threshold", "unit", "ms", "reason")
    return "\n".join(
        (head, *(_format_row(decision, ms.get(decision.effect)) for decision in decisions))
    )


def _format_row(decision: EffectDecision, ms: float | None) -> str:
    state = "on" if decision.enabled else "off"
    numbers = (f"{decision.bound:.3g}", f"{decision.threshold:.3g}")
    taken = "" if ms is None else f"{ms:.1f}"
    return _ROW_FORMAT.format(
        decision.effect, state, *numbers, decision.unit, taken, decision.reason
    )
