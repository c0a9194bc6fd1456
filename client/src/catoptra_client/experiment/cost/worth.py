"""What the frames of a step are worth: shares found, errors measured, places believed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from catoptra_client.experiment.measurements import found_share, rms_errors
from catoptra_client.experiment.replay import Trace
from catoptra_client.experiment.session import SetupResult
from catoptra_client.experiment.setups import HONEST_FILTER, LONGEST_RANGE_M, PAPER_FILTER
from catoptra_protocol.landmarks import Landmark

# Nearer, a beacon is at least 5 px wide in a picture of 360 px: what is missed is not too small.
NEAR_M = 1.5


def worth(
    step: str, result: SetupResult, landmarks: Sequence[Landmark]
) -> dict[str, str | int | float | None]:
    """Return a row of cost.json's `landmarks`, over all runs of a step."""
    recordings = result.recordings
    range_m, bearing_deg = rms_errors(recordings, landmarks)
    paper, honest = (_place_errors(result.traces[f.name]) for f in (PAPER_FILTER, HONEST_FILTER))
    return {
        "step": step,
        "frames": sum(len(recording.steps) - 1 for recording in recordings),
        "found": found_share(recordings, landmarks, within_m=LONGEST_RANGE_M),
        "found_near": found_share(recordings, landmarks, within_m=NEAR_M),
        "bearing_rms_deg": _told(bearing_deg),
        "range_rms_m": _told(range_m),
        "ekf_mean_m": paper[0],
        "ekf_max_m": paper[1],
        "honest_ekf_mean_m": honest[0],
        "honest_ekf_max_m": honest[1],
    }


def _told(value: float) -> float | None:
    """Return a number for JSON, which has no NaN: none where nothing was seen."""
    return None if math.isnan(value) else value


def _place_errors(traces: Sequence[Trace]) -> tuple[float, float]:
    """Return the medians over the runs of a run's mean and largest position error, metres."""
    means = [trace.estimate_error_m[1:].mean() for trace in traces]
    return float(np.median(means)), float(np.median([t.estimate_error_m.max() for t in traces]))


def summary(rows: Sequence[dict[str, Any]], result: SetupResult) -> dict[str, Any]:
    """Return cost.json's `landmarks`; odometry is the same for all steps, so any result tells."""
    traces = result.traces[PAPER_FILTER.name]
    return {
        "runs": len(traces),
        "steps_a_run": len(traces[0].odometry_error_m) - 1,
        "odometry_max_m": float(np.median([trace.odometry_error_m.max() for trace in traces])),
        "rows": list(rows),
    }
