"""Report of the decision experiment: how well each effect's decision follows the truth.

| quantity     | meaning                                                                      |
|--------------|------------------------------------------------------------------------------|
| truth on     | situations in which the effect's change is above either threshold            |
| wrongly off  | truth on, decision off: must not occur                                       |
| needless on  | decision on, truth below half of both thresholds                             |
| agreement    | situations in which decision and truth are both on or both off               |
| vary         | effects that are on in some situations and off in others; within a condition |
|              | also at the same light, air and sensor                                       |
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from catoptra_server.effects import EFFECT_TYPES
from catoptra_studies.effects.decision_experiment import TrialDecision

_MAX_NEEDLESS_FRACTION = 0.03
_MIN_AGREEMENT = 0.97
# Of the whole experiment; fewer situations have to have as many in proportion.
_MIN_MEASURED_PER_SITUATION = 3000 / 960
# Of the whole experiment alone: few situations are alike.
_MIN_VARYING, _WHOLE = 10, 900
# A renderer computes the change from 32-bit light and a fast encoding, the truth from 64 bits.
_TOLERANCE_GREY_LEVELS = 0.02
# Of pixels that change by half a level within that tolerance.
_TOLERANCE_SHARE = 0.002

_HEAD = (
    "| effect | situations | truth on | decision on | wrongly off | needless on | agreement "
    "| proved off | measured |"
)


@dataclass(frozen=True, slots=True)
class _EffectScore:
    """Counts of one effect's situations."""

    effect: str
    num_situations: int
    num_truth_on: int
    num_on: int
    num_wrongly_off: int
    num_needless_on: int
    num_agreeing: int
    num_proved_off: int
    num_measured: int

    @property
    def agreement(self) -> float:
        """Fraction of situations in which the decision is the truth."""
        return self.num_agreeing / self.num_situations

    @property
    def truth_crosses(self) -> bool:
        """Whether the truth is on in some situations and off in others."""
        return 0 < self.num_truth_on < self.num_situations


@dataclass(frozen=True, slots=True)
class DecisionReport:
    """Scores of all effects, and whether the decisions are good enough."""

    scores: tuple[_EffectScore, ...]
    """In optical order."""
    num_situations: int
    varying: tuple[str, ...]
    """Effects that are on in some situations and off in others."""
    varying_alike: tuple[str, ...]
    """Those of them that do so within one condition."""
    failures: tuple[str, ...]
    """What falls short, in words; empty if nothing does."""

    def __str__(self) -> str:
        rows = [
            f"| {one.effect} | {one.num_situations} | {one.num_truth_on} | {one.num_on} "
            f"| {one.num_wrongly_off} | {one.num_needless_on} | {100 * one.agreement:.1f} % "
            f"| {one.num_proved_off} | {one.num_measured} |"
            for one in (*self.scores, self._total())
        ]
        line = "|---|" + "---|" * 8
        alike = ", ".join(self.varying_alike) or "none"
        counts = (
            f"{len(self.varying)} of {len(self.scores)} decisions vary; at the same light, air and "
            f"sensor {len(self.varying_alike)}: {alike}."
        )
        verdict = [f"* falls short: {text}" for text in self.failures] or ["All criteria are met."]
        return "\n".join((_HEAD, line, *rows, "", counts, "", *verdict))

    def _total(self) -> _EffectScore:
        sums = (sum(getattr(one, name) for one in self.scores) for name in _COUNTS)
        return _EffectScore("all", *sums)


_ORDER = {name: number for number, name in enumerate(EFFECT_TYPES)}
_COUNTS = tuple(name for name in _EffectScore.__dataclass_fields__ if name != "effect")


def evaluate_decisions(decisions: Sequence[TrialDecision]) -> DecisionReport:
    """Score the decisions of an experiment."""
    by_effect: dict[str, list[TrialDecision]] = {}
    for one in sorted(decisions, key=lambda one: _ORDER.get(one.effect, len(_ORDER))):
        by_effect.setdefault(one.effect, []).append(one)
    scores = tuple(_score(effect, own) for effect, own in by_effect.items())
    num_situations = len({(one.world, one.place, one.motion) for one in decisions})
    states = {(one.effect, "", one.enabled) for one in decisions}
    states |= {(one.effect, one.condition, one.enabled) for one in decisions}
    varied = {name for name in states if (*name[:2], not name[2]) in states}
    varying = tuple(one for one in by_effect if (one, "", True) in varied)
    alike = tuple(one for one in varying if any(n == one and c for n, c, _ in varied))
    failures = _find_failures(scores, num_situations)
    if num_situations >= _WHOLE and len(varying) < _MIN_VARYING:
        failures.append(f"only {len(varying)} decisions vary")
    return DecisionReport(scores, num_situations, varying, alike, tuple(failures))


def _is_wrongly_off(one: TrialDecision) -> bool:
    """Whether an effect is left out whose change is above a threshold."""
    if one.enabled:
        return False
    if not one.is_measured:  # a bound has no tolerance: computed in float64, never below the truth
        return one.exceeds(1.0)
    return one.exceeds(1.0, levels=_TOLERANCE_GREY_LEVELS, share=_TOLERANCE_SHARE)


def _is_needless_on(one: TrialDecision) -> bool:
    """Whether an effect is on whose change is below half of both thresholds."""
    return one.enabled and not one.exceeds(0.5)


def _score(effect: str, decisions: Sequence[TrialDecision]) -> _EffectScore:
    return _EffectScore(
        effect,
        num_situations=len(decisions),
        num_truth_on=sum(one.exceeds(1.0) for one in decisions),
        num_on=sum(one.enabled for one in decisions),
        num_wrongly_off=sum(map(_is_wrongly_off, decisions)),
        num_needless_on=sum(map(_is_needless_on, decisions)),
        num_agreeing=sum(one.enabled == one.exceeds(1.0) for one in decisions),
        num_proved_off=sum(not one.enabled and not one.is_measured for one in decisions),
        num_measured=sum(one.is_measured for one in decisions),
    )


def _find_failures(scores: Sequence[_EffectScore], num_situations: int) -> list[str]:
    failures = [
        f"{one.effect} is wrongly off in {one.num_wrongly_off} situations"
        for one in scores
        if one.num_wrongly_off
    ]
    num_decisions = sum(one.num_situations for one in scores)
    needless = sum(one.num_needless_on for one in scores)
    if needless > _MAX_NEEDLESS_FRACTION * num_decisions:
        failures.append(f"{needless} of {num_decisions} decisions are needlessly on")
    failures += [
        f"{one.effect} follows its truth in {100 * one.agreement:.1f} % of the situations"
        for one in scores
        if one.truth_crosses and one.agreement < _MIN_AGREEMENT
    ]
    measured = sum(one.num_measured for one in scores)
    if measured < _MIN_MEASURED_PER_SITUATION * num_situations:
        failures.append(f"only {measured} decisions are measured")
    return failures


def write_decision_report(
    folder: Path, report: DecisionReport, decisions: Sequence[TrialDecision]
) -> None:
    """Write decisions.md with the table, and decisions.json with every decision and truth."""
    folder.mkdir(parents=True, exist_ok=True)
    worlds = ", ".join(dict.fromkeys(one.world for one in decisions))
    head = (
        "# Decisions about effects beside the truth\n\n"
        f"{report.num_situations} situations of the shipped real camera in {worlds}.\n\n"
    )
    (folder / "decisions.md").write_text(f"{head}{report}\n", encoding="utf-8")
    content = {
        "scores": [asdict(one) for one in report.scores],
        "failures": list(report.failures),
        "decisions": [asdict(one) for one in decisions],
    }
    (folder / "decisions.json").write_text(json.dumps(content) + "\n", encoding="utf-8")
