"""The levels of a sweep at which colour classification and the filter fail."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M


@dataclass(frozen=True, slots=True)
class FailureLevels:
    """Labels of the first levels that fail in four ways; None where all levels pass."""

    detection_below_90_percent: str | None
    """Detection rate below nine tenths of that in clean images."""

    detection_below_50_percent: str | None
    """Detection rate below half of that in clean images."""

    ekf_error_above_twice_clean: str | None
    """Largest position error more than twice that with clean images."""

    ekf_error_above_paper: str | None
    """Largest position error above the paper's bound."""


def find_failure_levels(
    clean: DegradationMetrics, levels: Sequence[tuple[str, DegradationMetrics]]
) -> FailureLevels:
    """Find the first failing level of a sweep.

    Args:
        clean: Metrics of clean images.
        levels: Label and metrics of each level, from slight to hopeless.
    """
    # Relative to clean images, in which the detector does not find every beacon either.
    return FailureLevels(
        detection_below_90_percent=_first_level(
            levels, lambda metrics: metrics.detection_rate < 0.9 * clean.detection_rate
        ),
        detection_below_50_percent=_first_level(
            levels, lambda metrics: metrics.detection_rate < 0.5 * clean.detection_rate
        ),
        ekf_error_above_twice_clean=_first_level(
            levels, lambda metrics: metrics.ekf_max_m > 2.0 * clean.ekf_max_m
        ),
        ekf_error_above_paper=_first_level(
            levels, lambda metrics: metrics.ekf_max_m > PAPER_EKF_ERROR_M
        ),
    )


def _first_level(
    levels: Sequence[tuple[str, DegradationMetrics]],
    condition: Callable[[DegradationMetrics], bool],
) -> str | None:
    # The first one, even if a later level passes again: a detector must not be trusted beyond.
    return next((label for label, metrics in levels if condition(metrics)), None)
