"""Decision before a frame: the effects that the scene calls for, with reasons. Pure, and cached.

A bound below the threshold proves an effect off, and the effect costs nothing. A bound above says
only that some scene could need the effect: the frame is drawn with it, cell by cell, and its own
largest change decides what the header says (`EffectPlan.decide_by_frame`). No pilot frame is drawn:
the frame's own pixels need no reserve, and what is drawn plainly costs little more than a pilot.

Decisions follow optical order: an effect is bounded for the light that reaches it, after the
enabled effects before.

The whole plan is cached by summary. Most frames of a driving robot have a new one, but only a speed
or a distance differs: behind the plan, each effect's bound is cached by the fields that the effect
declares to read. A test compares the declaration with the fields that each criterion reads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import lru_cache
from typing import Any

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    UNCHANGED,
    VISIBLE_LEVELS,
    WORLD_EFFECTS,
    DecisionBasis,
    EffectBound,
    EffectChange,
    EffectMode,
    EffectSetting,
    EffectSettings,
    Gains,
    ImageEffect,
    SceneEffect,
    SceneSummary,
    Spill,
    Threshold,
    chain_factors,
    following_factors,
    is_image_effect,
    is_scene_effect,
)
from catoptra_server.world.objects import CameraState

# Effects by name: their modules are loaded for the files that name them.
_DEFOCUS, _DEFOCUS_BY_DEPTH, _MOSAIC = "Defocus", "DefocusByDepth", "Bayer"
_AUTO_EXPOSURE = "AutoExposure"


@dataclass(frozen=True, slots=True)
class EffectDecision:
    """Decision on one effect for one exposure."""

    effect: str
    """The effect's name."""
    enabled: bool
    bound: float
    """Upper bound of the change of any pixel, grey levels."""
    threshold: float
    """Largest change at which `auto` leaves the effect out, grey levels."""
    reason: str
    displacement_px: float | None = None
    """Upper bound of the displacement of light; None for an effect that displaces none."""
    basis: DecisionBasis = DecisionBasis.PROVED
    share_threshold: float = 1.0
    """Largest share of pixels that change by more than VISIBLE_LEVELS at which `auto` leaves the
    effect out."""
    visible_share: float = 1.0
    """Upper bound of that share, of this frame."""
    change: float | None = None
    """Upper bound of the change of any pixel of this frame, grey levels, from its own pixels: the
    largest change where it arises, times the largest gain of what follows. None if nobody
    measured it."""
    included_in: str = ""
    """Name of the enabled effect that does the work of this one; empty for none."""


@dataclass(frozen=True, slots=True)
class EffectPlan:
    """Decisions on all effects that a robot file names, and the enabled ones in optical order."""

    decisions: tuple[EffectDecision, ...] = ()
    scene_effects: tuple[SceneEffect, ...] = ()
    """Enabled effects that change the scene."""
    image_effects: tuple[ImageEffect, ...] = ()
    """Enabled effects that change the image."""
    thresholds: Mapping[str, Threshold] = field(default_factory=dict, compare=False)
    """Changes that nobody misses, of the enabled effects: `renderer.View.render`."""

    def find_displacement_px(self, effect_name: str) -> float:
        """Largest displacement by an effect; 0 for one that displaces nothing or is not named."""
        found = (one.displacement_px for one in self.decisions if one.effect == effect_name)
        return next(found, None) or 0.0

    def end_measures(self) -> EffectPlan:
        """The plan of a frame that need not find the largest change of what is surely on."""
        may_end = {name: replace(one, may_end=True) for name, one in self.thresholds.items()}
        return replace(self, thresholds=may_end)

    def decide_by_frame(self, changes: Mapping[str, EffectChange]) -> tuple[EffectDecision, ...]:
        """Decisions with what a frame shows: an effect that changes too little in it is off.

        Args:
            changes: Change by effect: `renderer.RenderedImage.changes`. Effects that the frame
                decides on and that the renderer does not measure are on, and say so.
        """
        if _DEFOCUS_BY_DEPTH in changes and not any(one.included_in for one in self.decisions):
            # As in its bound, with no `Defocus` to count from.
            changes = dict(changes)
            changes[_DEFOCUS_BY_DEPTH] = changes.pop(_DEFOCUS, changes[_DEFOCUS_BY_DEPTH])
        decided = [self._decide(one, changes.get(one.effect)) for one in self.decisions]
        enabled = {one.effect for one in decided if one.enabled}
        # What an effect includes stays off only as long as that effect is on.
        return tuple(
            before if before.included_in in enabled else after
            for before, after in zip(self.decisions, decided, strict=True)
        )

    def _decide(self, decision: EffectDecision, change: EffectChange | None) -> EffectDecision:
        """Decision with the change in a frame; None for one that nobody measured."""
        if change is not None:
            return _decide_by_change(decision, change)
        threshold = self.thresholds.get(decision.effect)
        if threshold is None or not threshold.is_measured:
            return decision
        return replace(decision, reason=NOT_MEASURED + decision.reason)

    def __str__(self) -> str:
        return format_decisions(self.decisions, {})


NOT_MEASURED = "this renderer cannot measure it; "
"""Begin of the reason of an effect on which the frame should decide, but cannot."""
NO_EFFECTS = EffectPlan()


@lru_cache(maxsize=256)
def plan_effects(
    settings: EffectSettings, summary: SceneSummary, camera: RadialCamera
) -> EffectPlan:
    """Decide which effects are enabled: `always`, or `auto` with a bound above the threshold.

    An effect whose work an enabled effect does as well is left out in every mode.

    Args:
        settings: Effects that the robot file names, in optical order.
        summary: Bounds on the scene; only `summary_fields` of the settings are needed.
        camera: Camera of the image.
    """
    decisions: list[EffectDecision] = []
    scene_effects: list[SceneEffect] = []
    image_effects: list[ImageEffect] = []
    allowed = {one.effect.name for one in settings.settings if one.mode is not EffectMode.NEVER}
    summary = replace(
        summary, has_defocus=_DEFOCUS in allowed, exposes_itself=_AUTO_EXPOSURE in allowed
    )
    for entry in _effect_entries(settings, camera):
        effect = entry.setting.effect
        decisions.append(_find_decision(entry, summary, settings))
        if not decisions[-1].enabled:
            continue
        if is_scene_effect(effect):
            scene_effects.append(effect)
        elif is_image_effect(effect):
            image_effects.append(effect)
        # Later criteria see the light as enabled effects leave it; disabled ones change nothing.
        summary = effect.update_summary(summary)
    thresholds = _thresholds(settings, decisions)
    return EffectPlan(tuple(decisions), tuple(scene_effects), tuple(image_effects), thresholds)


def apply_scene_effects(camera_state: CameraState, plan: EffectPlan) -> CameraState:
    """Camera state with all enabled scene effects, in optical order."""
    for effect in plan.scene_effects:
        displacement_px = plan.find_displacement_px(effect.name)
        camera_state = effect.apply_to_scene(camera_state, displacement_px)
    left_out = [one.effect for one in plan.decisions if not one.enabled]
    fields: dict[str, Any] = {WORLD_EFFECTS[n]: False for n in left_out if n in WORLD_EFFECTS}
    return replace(camera_state, **fields) if fields else camera_state


def describe_changes(before: Sequence[EffectDecision], after: Sequence[EffectDecision]) -> str:
    """Effects that a frame decides otherwise than an earlier one, in words; empty for none."""
    was_enabled = {one.effect: one.enabled for one in before}
    return ", ".join(
        f"{one.effect} {'on' if one.enabled else 'off'} ({one.reason})"
        for one in after
        if one.enabled != was_enabled.get(one.effect)
    )


_ROW_FORMAT = "{:<20} {:<4}{:<9} {:>7} {:>7} {:>10} {:>8} {:>8} {:>7} {:>7}  {}"


def format_decisions(decisions: Sequence[EffectDecision], ms: Mapping[str, float]) -> str:
    """Format decisions as a table with one row per effect.

    Args:
        decisions: Rows, in optical order.
        ms: Milliseconds of enabled effects by name, where known.
    """
    if not decisions:
        return "no effects: the robot file names none"
    head = _ROW_FORMAT.format(
        *("effect", "", "basis", "change", "bound", "threshold", "visible", "allowed"),
        *("px", "ms", "reason"),
    )
    rows = (_format_row(decision, ms.get(decision.effect)) for decision in decisions)
    return "\n".join((head, *rows))


def _format_row(decision: EffectDecision, ms: float | None) -> str:
    state = "on" if decision.enabled else "off"
    change = "" if decision.change is None else f"{decision.change:.3g}"
    numbers = (change, f"{decision.bound:.3g}", f"{decision.threshold:.3g}")
    px = "" if decision.displacement_px is None else f"{decision.displacement_px:.3g}"
    time_ms = "" if ms is None else f"{ms:.1f}"
    return _ROW_FORMAT.format(
        decision.effect,
        state,
        decision.basis.value,
        *numbers,
        # Of an effect that the largest change decides nobody counts the pixels.
        "" if decision.visible_share == 1.0 else _percent(decision.visible_share),
        _percent(decision.share_threshold),
        px,
        time_ms,
        decision.reason,
    )


def _decide_by_change(decision: EffectDecision, change: EffectChange) -> EffectDecision:
    reason = decision.reason.removeprefix(_included_reason(decision.included_in))
    allowed = Threshold(decision.threshold, visible_share=decision.share_threshold)
    measured = replace(
        decision,
        enabled=not allowed.covers(change),
        basis=DecisionBasis.MEASURED,
        visible_share=change.visible_share,
        included_in="",
    )
    if change.largest == math.inf:
        return replace(measured, reason=f"seen in this frame; {reason}")
    limit = "at least" if change.is_partial else "at most"
    reason = f"{limit} {_describe_change(change)} in this frame; {reason}"
    return replace(measured, change=change.largest, reason=reason)


def _describe_change(change: EffectChange) -> str:
    if change.visible_share in (0.0, 1.0):
        return f"{change.largest:.3g}"
    share = f"more than {VISIBLE_LEVELS} in {_percent(change.visible_share)} of them"
    return f"{change.largest:.3g} levels in any pixel, {share},"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %"


def _thresholds(
    settings: EffectSettings, decisions: Sequence[EffectDecision]
) -> Mapping[str, Threshold]:
    """Thresholds of the enabled effects; the frame decides on those in mode auto."""
    decided = [
        setting.effect.gains if decision.enabled else UNCHANGED
        for setting, decision in zip(settings.settings, decisions, strict=True)
    ]
    names = [one.effect for one in decisions if one.enabled]
    before_mosaic = names[: names.index(_MOSAIC)] if _MOSAIC in names else ()
    # In mode always an effect is drawn everywhere, however little it changes.
    return {
        decision.effect: Threshold(
            settings.threshold.max_change
            if setting.mode is EffectMode.AUTO and settings.basis is DecisionBasis.MEASURED
            else -1.0,
            gains,
            settings.visible_share,
            spill,
            decision.effect in before_mosaic,
        )
        for setting, decision, (gains, spill) in zip(
            settings.settings, decisions, chain_factors(settings, decided), strict=True
        )
        if decision.enabled
    }


# Bounds, and decisions, of one effect in one camera. Summaries are rounded to cells, so a drive
# through a world has some hundreds of them.
_MAX_CACHED = 512


@dataclass(frozen=True, slots=True, eq=False)
class _EffectEntry:
    """One setting with the caches of its bounds and decisions for one camera."""

    setting: EffectSetting
    camera: RadialCamera
    gains: Gains
    """Factors from the light at the effect to that of the finished picture."""
    spill: Spill
    bounds: dict[tuple[object, ...], EffectBound] = field(default_factory=dict)
    """Bounds by the fields of a summary that the effect reads."""
    decisions: dict[EffectBound, EffectDecision] = field(default_factory=dict)

    def find_bound(self, summary: SceneSummary) -> EffectBound:
        """The effect's bound, computed only for values not met before."""
        effect, spilt = self.setting.effect, self._max_spilt_levels(summary)
        key = (spilt, *(getattr(summary, name) for name in effect.reads))
        bound = self.bounds.get(key)
        if bound is None:
            # First in, first out: a robot leaves cells behind, so the oldest entry is the one
            # least likely to return.
            while len(self.bounds) >= _MAX_CACHED:
                self.bounds.pop(next(iter(self.bounds)))
            summary = replace(summary, gains=self.gains)
            bound = effect.bound(summary, self.camera)
            if spilt and bound.value:
                # Its own pixel's change and, behind white, that of a black one beside it.
                bound = replace(bound, value=min(bound.value + spilt, 255.0))
            self.bounds[key] = bound
        return bound

    def _max_spilt_levels(self, summary: SceneSummary) -> float:
        """Grey level of what the brightest light spills over a black pixel."""
        gain, part = self.spill
        if part == 0.0:
            return 0.0
        after = self.setting.effect.update_summary(summary)
        excess = gain * max(summary.max_radiance, after.max_radiance) - 1.0
        if excess <= 0.0:
            return 0.0
        # Loaded with the effect that spills.
        from catoptra_server.effects.kernels.grey_levels import grey_level

        return grey_level(part * excess)


@lru_cache(maxsize=64)
def _effect_entries(settings: EffectSettings, camera: RadialCamera) -> tuple[_EffectEntry, ...]:
    rows = zip(settings.settings, following_factors(settings), strict=True)
    return tuple(_EffectEntry(setting, camera, *factors) for setting, factors in rows)


def _find_decision(
    entry: _EffectEntry, summary: SceneSummary, settings: EffectSettings
) -> EffectDecision:
    # Also in mode always: applied twice, the disc of Defocus would blur the blurred image again.
    by = dict(summary.included_effects).get(entry.setting.effect.name)
    bound = entry.find_bound(summary)
    decision = entry.decisions.get(bound)
    if decision is None:
        # Cleared whole instead of one by one: bounds repeat far more often than summaries, so the
        # limit is hardly ever reached.
        if len(entry.decisions) >= _MAX_CACHED:
            entry.decisions.clear()
        decision = entry.decisions[bound] = _decide(entry.setting, bound, settings)
    if by is not None and entry.setting.mode is not EffectMode.NEVER:
        reason = _included_reason(by) + decision.reason
        return replace(decision, enabled=False, included_in=by, reason=reason)
    return decision


def _included_reason(by: str) -> str:
    return f"{by} includes this one; "


def _decide(setting: EffectSetting, bound: EffectBound, settings: EffectSettings) -> EffectDecision:
    enabled = {
        EffectMode.ALWAYS: True,
        EffectMode.NEVER: False,
        EffectMode.AUTO: not settings.is_negligible(bound),
    }[setting.mode]
    prefix = "" if setting.mode is EffectMode.AUTO else f"{setting.mode.value} by setting; "
    return EffectDecision(
        effect=setting.effect.name,
        enabled=enabled,
        bound=bound.value,
        threshold=settings.threshold.max_change,
        share_threshold=settings.visible_share,
        visible_share=EffectChange(bound.value).visible_share,
        reason=f"{prefix}{bound.reason}",
        displacement_px=bound.displacement_px,
    )
