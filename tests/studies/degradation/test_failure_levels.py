"""The level at which a sweep starts to fail."""

from __future__ import annotations

from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    FailureLevels,
    find_failure_levels,
)


def make_metrics(num_detected: int, ekf_max_m: float) -> DegradationMetrics:
    return DegradationMetrics(100, 100, num_detected, 0.0, 0.1, 0.02, ekf_max_m, 0.05, 2.0)


CLEAN = make_metrics(80, 0.2)


def test_rates_are_relative_to_those_of_clean_images() -> None:
    levels = [
        ("a", make_metrics(73, 0.2)),
        ("b", make_metrics(71, 0.2)),
        ("c", make_metrics(39, 0.2)),
    ]
    assert find_failure_levels(CLEAN, levels) == FailureLevels(
        detection_below_90_percent="b",
        detection_below_50_percent="c",
        ekf_error_above_twice_clean=None,
        ekf_error_above_paper=None,
    )


def test_errors_are_compared_with_clean_ones_and_the_papers_bound() -> None:
    levels = [
        ("a", make_metrics(80, 0.4)),
        ("b", make_metrics(80, 0.41)),
        ("c", make_metrics(80, 0.61)),
    ]
    assert find_failure_levels(CLEAN, levels) == FailureLevels(
        detection_below_90_percent=None,
        detection_below_50_percent=None,
        ekf_error_above_twice_clean="b",
        ekf_error_above_paper="c",
    )


def test_first_level_counts_when_a_later_one_is_better() -> None:
    levels = [("a", make_metrics(10, 0.7)), ("b", make_metrics(80, 0.1))]
    assert find_failure_levels(CLEAN, levels) == FailureLevels("a", "a", "a", "a")
