from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from catoptra_studies.effects.decision_experiment import TrialDecision
from catoptra_studies.effects.decision_report import (
    DecisionReport,
    evaluate_decisions,
    write_decision_report,
)

ON = TrialDecision(
    world="field",
    place=0,
    motion="at rest",
    effect="Bayer",
    enabled=True,
    is_measured=True,
    bound=255.0,
    change=3.0,
    threshold=0.5,
    truth=3.0,
)
OFF = replace(ON, enabled=False, is_measured=False, bound=0.4, change=None, truth=0.3)


def evaluate(*groups: tuple[TrialDecision, int], effects: int = 4) -> DecisionReport:
    """Report of decisions, each in a number of situations, with enough measured others."""
    decisions = [one for one, count in groups for one in [one] * count]
    decisions = [replace(one, place=place) for place, one in enumerate(decisions)]
    others = [
        replace(ON, effect=f"other {number}", place=one.place)
        for one in decisions
        for number in range(effects)
    ]
    return evaluate_decisions((*decisions, *others))


def test_right_decisions_meet_all_criteria() -> None:
    report = evaluate((ON, 50), (OFF, 50))
    assert report.failures == ()
    assert report.num_situations == 100
    first = report.scores[0]
    assert (first.effect, first.num_truth_on, first.num_on, first.agreement) == ("Bayer", 50, 50, 1)
    assert (first.num_proved_off, first.num_measured) == (50, 50)
    assert "All criteria are met." in str(report)


def test_one_effect_wrongly_off_is_a_failure() -> None:
    report = evaluate((ON, 50), (OFF, 49), (replace(OFF, truth=0.501), 1))
    assert report.failures == ("Bayer is wrongly off in 1 situations",)
    measured = replace(OFF, is_measured=True, change=0.49)
    report = evaluate((ON, 99), (replace(measured, truth=0.6), 1))
    assert report.failures == ("Bayer is wrongly off in 1 situations",)


def test_rounding_of_a_measured_change_is_tolerated() -> None:
    report = evaluate((ON, 99), (replace(OFF, is_measured=True, change=0.499, truth=0.505), 1))
    assert report.failures == ()
    assert report.scores[0].agreement == 0.99


def test_needless_effects_count_over_all_decisions() -> None:
    needless = replace(ON, truth=0.2)
    assert evaluate((OFF, 85), (needless, 15)).failures == ()
    # 16 of 500 decisions.
    assert evaluate((OFF, 84), (needless, 16)).failures[0] == (
        "16 of 500 decisions are needlessly on"
    )
    # Between half the threshold and the threshold an effect is neither needless nor wrong.
    assert evaluate((replace(ON, truth=0.3), 100)).failures == ()


def test_effect_that_crosses_its_threshold_is_to_be_followed() -> None:
    late = replace(ON, truth=0.4)
    assert evaluate((ON, 50), (OFF, 47), (late, 3)).failures == ()
    report = evaluate((ON, 50), (OFF, 46), (late, 4))
    assert report.failures == ("Bayer follows its truth in 96.0 % of the situations",)


def test_too_few_measured_decisions_are_a_failure() -> None:
    report = evaluate((ON, 100), effects=2)
    assert report.failures == ("only 300 decisions are measured",)
    assert "* falls short: only 300 decisions are measured" in str(report)


def test_report_is_written_with_every_decision(tmp_path: Path) -> None:
    decisions = (ON, OFF)
    write_decision_report(tmp_path / "out", evaluate_decisions(decisions), decisions)
    content = json.loads((tmp_path / "out/decisions.json").read_text())
    assert [one["truth"] for one in content["decisions"]] == [3.0, 0.3]
    assert content["scores"][0]["num_on"] == 1
    page = (tmp_path / "out/decisions.md").read_text()
    assert "| Bayer | 2 | 1 | 1 | 0 | 0 | 100.0 % | 1 | 1 |" in page
