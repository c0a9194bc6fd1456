"""Rates and errors of the drives with one level's frames, as rows of the results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_studies.accuracy_cost.cost_results import LocalizationAccuracy, LocalizationRow
from catoptra_studies.experiment.experiment_runner import SetupResult
from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    MAX_RANGE_M,
    PAPER_FILTER,
)
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.metrics import detection_rate, rms_errors

# A nearer beacon is at least 5 px wide in an image of 360 px: a miss is not due to its size.
NEAR_RANGE_M = 1.5


def localization_row(
    level: str, result: SetupResult, landmarks: Sequence[Landmark]
) -> LocalizationRow:
    """Rates and errors over all drives with frames of a level."""
    drive_logs = result.drive_logs
    range_rms_m, bearing_rms_deg = rms_errors(drive_logs, landmarks)
    paper, consistent = (
        _position_errors(result.filter_runs[settings.name])
        for settings in (PAPER_FILTER, CONSISTENT_FILTER)
    )
    return LocalizationRow(
        level=level,
        num_frames=sum(len(drive_log.steps) - 1 for drive_log in drive_logs),
        detection_rate=detection_rate(drive_logs, landmarks, max_distance_m=MAX_RANGE_M),
        near_detection_rate=detection_rate(drive_logs, landmarks, max_distance_m=NEAR_RANGE_M),
        bearing_rms_deg=bearing_rms_deg,
        range_rms_m=range_rms_m,
        ekf_mean_m=paper[0],
        ekf_max_m=paper[1],
        consistent_ekf_mean_m=consistent[0],
        consistent_ekf_max_m=consistent[1],
    )


def _position_errors(filter_runs: Sequence[FilterRun]) -> tuple[float, float]:
    """Medians over the drives of a drive's mean and largest position error, in metres."""
    # The start is left out of the mean: its position is given.
    means_m = [run.estimate_error_m[1:].mean() for run in filter_runs]
    # Medians below, since one locked-out drive would decide a mean of ten.
    maxima_m = [run.estimate_error_m.max() for run in filter_runs]
    return float(np.median(means_m)), float(np.median(maxima_m))


def summarize_localization(
    rows: Sequence[LocalizationRow], result: SetupResult
) -> LocalizationAccuracy:
    """Put the rows together.

    Args:
        rows: One row for each level.
        result: Drives of any level; odometry is the same in all, since the seeds are.
    """
    filter_runs = result.filter_runs[PAPER_FILTER.name]
    return LocalizationAccuracy(
        num_runs=len(filter_runs),
        steps_per_run=len(filter_runs[0].odometry_error_m) - 1,
        odometry_max_m=float(np.median([run.odometry_error_m.max() for run in filter_runs])),
        rows=tuple(rows),
    )
