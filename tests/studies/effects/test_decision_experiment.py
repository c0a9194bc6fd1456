"""The experiment of `make effects` in small: 16 situations, 40 by `make long-test`."""

from __future__ import annotations

import pytest

from catoptra_studies.effects.decision_experiment import DecisionStudy, run_decision_study
from catoptra_studies.effects.decision_report import evaluate_decisions, is_wrongly_off
from catoptra_studies.effects.decision_trial import TrialDecision
from helpers.long_cases import quick_cases


@pytest.fixture(scope="module", params=quick_cases([2, 5], 0))
def decisions(request: pytest.FixtureRequest) -> tuple[TrialDecision, ...]:
    """Decisions at some places of two worlds, in all motions."""
    worlds = ("four_legged_2006", "rescue")
    return run_decision_study(
        DecisionStudy(request.param, worlds=worlds, width_px=160, num_processes=1)
    )


def test_situations_are_worlds_times_places_times_motions(
    decisions: tuple[TrialDecision, ...],
) -> None:
    num_places = len({one.place for one in decisions})
    assert evaluate_decisions(decisions).num_situations == 2 * 4 * num_places


def test_all_criteria_of_the_experiment_are_met(decisions: tuple[TrialDecision, ...]) -> None:
    assert evaluate_decisions(decisions).failures == ()


def test_measured_changes_are_the_truth(decisions: tuple[TrialDecision, ...]) -> None:
    # At rest: in motion the frame is the mean of fewer instants than the truth. Of the own body
    # the renderer only says whether it is in view.
    compared = [
        (one.effect, one.change, one.truth)
        for one in decisions
        if one.change is not None and one.motion == "at rest" and one.effect != "SelfView"
    ]
    assert len(compared) > 40
    far = [row for row in compared if abs(row[1] - row[2]) > 0.05 + 0.02 * row[2]]
    assert far == []


def test_no_effect_is_left_out_that_changes_a_pixel_visibly(
    decisions: tuple[TrialDecision, ...],
) -> None:
    wrong = [one for one in decisions if is_wrongly_off(one)]
    assert wrong == []
    # Both sides of a threshold occur, so that a decision could be wrong.
    moving = [one.truth > one.threshold for one in decisions if one.effect == "MotionBlur"]
    assert any(moving)
    assert not all(moving)


def test_bounds_are_never_below_the_truth(decisions: tuple[TrialDecision, ...]) -> None:
    # Rounding apart: a bound may be the truth itself, and maps of gains are of 32 bits.
    below = [one for one in decisions if one.truth > one.bound + 1e-3]
    assert below == []


def test_processes_share_the_places_without_a_change() -> None:
    calls = []
    small = DecisionStudy(num_places=1, worlds=("rescue",), width_px=48, num_processes=1)
    alone = run_decision_study(small, on_place=lambda: calls.append(1))
    pair = DecisionStudy(num_places=1, worlds=("rescue",), width_px=48, num_processes=2)
    assert run_decision_study(pair) == alone
    assert calls == [1]
