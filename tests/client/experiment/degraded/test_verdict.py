"""At which rung a ladder starts to fail."""

from __future__ import annotations

from catoptra_client.experiment.degraded.measures import Figures
from catoptra_client.experiment.degraded.verdict import Verdict, verdict


def measured(found: int, ekf_max_m: float) -> Figures:
    return Figures(100, 100, found, 0.0, 0.1, 0.02, ekf_max_m, 0.05, 2.0)


CLEAN = measured(80, 0.2)


def test_shares_are_of_what_is_found_in_clean_pictures() -> None:
    rungs = [("a", measured(73, 0.2)), ("b", measured(71, 0.2)), ("c", measured(39, 0.2))]
    assert verdict(CLEAN, rungs) == Verdict(falters="b", fails="c", drifts=None, lost=None)


def test_errors_are_against_clean_ones_and_the_papers_limit() -> None:
    rungs = [("a", measured(80, 0.4)), ("b", measured(80, 0.41)), ("c", measured(80, 0.61))]
    assert verdict(CLEAN, rungs) == Verdict(falters=None, fails=None, drifts="b", lost="c")


def test_first_rung_counts_when_a_later_one_is_better() -> None:
    rungs = [("a", measured(10, 0.7)), ("b", measured(80, 0.1))]
    assert verdict(CLEAN, rungs) == Verdict("a", "a", "a", "a")
