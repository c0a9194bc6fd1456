"""Where on a ladder colour classification starts to fail, and where the filter does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics

# The paper's limit: what its filter keeps below.
PAPER_EKF_ERROR_M = 0.6


@dataclass(frozen=True, slots=True)
class FailureLevels:
    """The first rung where something happens; None where nothing does up to the last.

    falters, fails: fewer than nine tenths, than half of the beacons found that were found in clean
    pictures. drifts: the filter's largest error more than doubles. lost: it exceeds PAPER_EKF_ERROR_M.
    """

    detection_below_90_percent: str | None
    detection_below_50_percent: str | None
    ekf_error_above_twice_clean: str | None
    ekf_error_above_paper: str | None


def find_failure_levels(
    clean: DegradationMetrics, levels: Sequence[tuple[str, DegradationMetrics]]
) -> FailureLevels:
    """Return the verdict on a ladder: its clean figures, and (label, figures) of its rungs."""
    return FailureLevels(
        detection_below_90_percent=_first_level(
            levels, lambda f: f.detection_rate < 0.9 * clean.detection_rate
        ),
        detection_below_50_percent=_first_level(
            levels, lambda f: f.detection_rate < 0.5 * clean.detection_rate
        ),
        ekf_error_above_twice_clean=_first_level(
            levels, lambda f: f.ekf_max_m > 2.0 * clean.ekf_max_m
        ),
        ekf_error_above_paper=_first_level(levels, lambda f: f.ekf_max_m > PAPER_EKF_ERROR_M),
    )


def _first_level(
    levels: Sequence[tuple[str, DegradationMetrics]],
    condition: Callable[[DegradationMetrics], bool],
) -> str | None:
    return next((label for label, figures in levels if condition(figures)), None)
