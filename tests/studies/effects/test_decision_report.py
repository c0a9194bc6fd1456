from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_studies.effects.decision_experiment import TrialDecision
from catoptra_studies.effects.decision_report import (
    DecisionReport,
    evaluate_decisions,
    write_decision_report,
)

ON = TrialDecision(
    world="field",
    place=0,
    condition="day",
    motion="at rest",
    effect="Bayer",
    enabled=True,
    is_measured=True,
    bound=255.0,
    change=3.0,
    visible_share=1.0,
    threshold=0.5,
    share_threshold=1.0,
    truth=3.0,
    true_share=0.75,
)
OFF = replace(ON, enabled=False, is_measured=False, bound=0.4, change=None, truth=0.3)
OFF = replace(OFF, visible_share=0.0, true_share=0.0)
# The largest change is allowed, the share of the pixels decides.
SHARED = replace(ON, threshold=8.0, share_threshold=0.5)


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
    assert "1 of 5 decisions vary; at the same light, air and sensor 1: Bayer." in str(report)
    assert "All criteria are met." in str(report)


MEASURED_OFF = replace(OFF, is_measured=True)
NEEDLESS, LATE = replace(ON, truth=0.2), replace(ON, truth=0.4)
WRONGLY_OFF = "Bayer is wrongly off in 1 situations"


@pytest.mark.parametrize(
    ("groups", "failures"),
    [
        ([(ON, 50), (OFF, 49), (replace(OFF, truth=0.501), 1)], (WRONGLY_OFF,)),
        ([(ON, 99), (replace(MEASURED_OFF, change=0.49, truth=0.6), 1)], (WRONGLY_OFF,)),
        # The rounding of a measured change is tolerated.
        ([(ON, 99), (replace(MEASURED_OFF, change=0.499, truth=0.505), 1)], ()),
        # Needless effects count over all decisions: 15 and 16 of 500.
        ([(OFF, 85), (NEEDLESS, 15)], ()),
        ([(OFF, 84), (NEEDLESS, 16)], ("16 of 500 decisions are needlessly on",)),
        # Between half the threshold and the threshold an effect is neither needless nor wrong.
        ([(replace(ON, truth=0.3), 100)], ()),
        # An effect that crosses its threshold is to be followed.
        ([(ON, 50), (OFF, 47), (LATE, 3)], ()),
        (
            [(ON, 50), (OFF, 46), (LATE, 4)],
            ("Bayer follows its truth in 96.0 % of the situations",),
        ),
        ([(SHARED, 50), (replace(SHARED, enabled=False, true_share=0.5), 50)], ()),
        ([(SHARED, 99), (replace(SHARED, enabled=False, true_share=0.51), 1)], (WRONGLY_OFF,)),
        ([(SHARED, 99), (replace(SHARED, enabled=False, true_share=0.501), 1)], ()),
        # Needless is what lies below half of both.
        ([(replace(SHARED, true_share=0.3), 100)], ()),
        ([(replace(SHARED, truth=4.1, true_share=0.2), 100)], ()),
        (
            [(replace(SHARED, true_share=0.2), 100)],
            ("100 of 500 decisions are needlessly on",),
        ),
    ],
)
def test_failures_are_named(
    groups: list[tuple[TrialDecision, int]], failures: tuple[str, ...]
) -> None:
    assert evaluate(*groups).failures == failures


def test_decision_that_light_alone_changes_varies_within_no_condition() -> None:
    report = evaluate((ON, 450), (replace(OFF, condition="night"), 450))
    assert (report.varying, report.varying_alike) == (("Bayer",), ())
    # A whole experiment has at least ten.
    assert report.failures == ("only 1 decisions vary",)


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
