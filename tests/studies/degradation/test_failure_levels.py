"""At which rung a ladder starts to fail."""

from __future__ import annotations

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics
from catoptra_studies.degradation.failure_levels import FailureLevels, find_failure_levels


def measured(found: int, ekf_max_m: float) -> DegradationMetrics:
    return DegradationMetrics(100, 100, found, 0.0, 0.1, 0.02, ekf_max_m, 0.05, 2.0)


CLEAN = measured(80, 0.2)


def test_shares_are_of_what_is_found_in_clean_pictures() -> None:
    rungs = [("a", measured(73, 0.2)), ("b", measured(71, 0.2)), ("c", measured(39, 0.2))]
    assert find_failure_levels(CLEAN, rungs) == FailureLevels(
        detection_below_90_percent="b",
        detection_below_50_percent="c",
        ekf_error_above_twice_clean=None,
        ekf_error_above_paper=None,
    )


def test_errors_are_against_clean_ones_and_the_papers_limit() -> None:
    rungs = [("a", measured(80, 0.4)), ("b", measured(80, 0.41)), ("c", measured(80, 0.61))]
    assert find_failure_levels(CLEAN, rungs) == FailureLevels(
        detection_below_90_percent=None,
        detection_below_50_percent=None,
        ekf_error_above_twice_clean="b",
        ekf_error_above_paper="c",
    )


def test_first_rung_counts_when_a_later_one_is_better() -> None:
    rungs = [("a", measured(10, 0.7)), ("b", measured(80, 0.1))]
    assert find_failure_levels(CLEAN, rungs) == FailureLevels("a", "a", "a", "a")
