"""What the frames of a step are worth: shares found, errors measured, places believed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_studies.experiment.experiment_runner import SetupResult
from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    MAX_RANGE_M,
    PAPER_FILTER,
)
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.experiment.measurement_metrics import detection_rate, rms_errors

# Nearer, a beacon is at least 5 px wide in a picture of 360 px: what is missed is not too small.
NEAR_RANGE_M = 1.5


def localization_accuracy(
    level: str, result: SetupResult, landmarks: Sequence[Landmark]
) -> dict[str, str | int | float | None]:
    """Return a row of cost.json's `landmarks`, over all runs of a step."""
    recordings = result.drive_logs
    range_m, bearing_deg = rms_errors(recordings, landmarks)
    paper, honest = (
        _position_errors(result.filter_runs[f.name]) for f in (PAPER_FILTER, CONSISTENT_FILTER)
    )
    return {
        "step": level,
        "frames": sum(len(recording.steps) - 1 for recording in recordings),
        "found": detection_rate(recordings, landmarks, max_distance_m=MAX_RANGE_M),
        "found_near": detection_rate(recordings, landmarks, max_distance_m=NEAR_RANGE_M),
        "bearing_rms_deg": _none_if_nan(bearing_deg),
        "range_rms_m": _none_if_nan(range_m),
        "ekf_mean_m": paper[0],
        "ekf_max_m": paper[1],
        "honest_ekf_mean_m": honest[0],
        "honest_ekf_max_m": honest[1],
    }


def _none_if_nan(value: float) -> float | None:
    """Return a number for JSON, which has no NaN: none where nothing was seen."""
    return None if math.isnan(value) else value


def _position_errors(filter_runs: Sequence[FilterRun]) -> tuple[float, float]:
    """Return the medians over the runs of a run's mean and largest position error, metres."""
    means = [trace.estimate_error_m[1:].mean() for trace in filter_runs]
    return float(np.median(means)), float(
        np.median([t.estimate_error_m.max() for t in filter_runs])
    )


def summarise_localization(rows: Sequence[dict[str, Any]], result: SetupResult) -> dict[str, Any]:
    """Return cost.json's `landmarks`; odometry is the same for all steps, so any result tells."""
    traces = result.filter_runs[PAPER_FILTER.name]
    return {
        "runs": len(traces),
        "steps_a_run": len(traces[0].odometry_error_m) - 1,
        "odometry_max_m": float(np.median([trace.odometry_error_m.max() for trace in traces])),
        "rows": list(rows),
    }
