"""Numbers of the drives: of each run, over all runs, and of their landmark measurements.

A run has errors of odometry and filter and the decisions of the gate; runs have medians and
quantiles. Measurements are compared with the true poses: errors, and how many beacons were found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats, wrap_angle
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M
from catoptra_studies.experiment.localization_filter import (
    FilterRun,
    acceptance_rate,
    find_relock_step,
)
from catoptra_studies.paper_values import PAPER_ODOMETRY_ERROR_M

# The paper counts steps from 1, and row 0 of a run is the start, so step k is row k. The robot
# reaches the first corner at the end of step 23; steps 85 to 100 are the diagonal.
_DIAGONAL_STEPS = slice(85, 101)
_FIRST_STEPS = slice(1, 6)


def _run_metrics(filter_run: FilterRun) -> dict[str, Any]:
    """Metrics of one run; acceptance rates are None where no landmark was measured."""
    estimate_m, odometry_m = filter_run.estimate_error_m, filter_run.odometry_error_m
    return {
        "run": filter_run.run,
        "odometry_max_m": float(odometry_m.max()),
        "odometry_steps_above_1m": int((odometry_m > PAPER_ODOMETRY_ERROR_M).sum()),
        "ekf_max_m": float(estimate_m.max()),
        # The start is given and would only dilute the mean.
        "ekf_mean_m": float(estimate_m[1:].mean()),
        # Along the first side, from the first landmarks to the corner.
        "ekf_mean_steps_9_to_23_m": float(estimate_m[9:24].mean()),
        # After the re-lock, along the second side and the third.
        "ekf_mean_steps_31_to_60_m": float(estimate_m[31:61].mean()),
        # On the way back to the start, where the paper reports a second growth.
        "ekf_max_steps_61_to_84_m": float(estimate_m[61:85].max()),
        "ekf_mean_on_diagonal_m": float(estimate_m[_DIAGONAL_STEPS].mean()),
        # Whether the gate accepts a landmark in the first step that measures one.
        "accepts_first_measurements": _accepts_first_measurements(filter_run),
        # Before the first corner, and along the first side up to the corner.
        "accepted_steps_1_to_22": acceptance_rate(filter_run, 1, 22),
        "accepted_steps_9_to_22": acceptance_rate(filter_run, 9, 22),
        "accepted_steps_23_to_40": acceptance_rate(filter_run, 23, 40),
        "accepted_steps_41_to_100": acceptance_rate(filter_run, 41, 100),
        # First accepting step after five that rejected all; None without such a streak.
        "relock_step": find_relock_step(filter_run),
        "longest_rejection_streak": int(filter_run.rejection_streak.max()),
        "windowed_nis_max": float(filter_run.windowed_nis.max()),
        # Of any step after the start.
        "fewest_landmarks_in_a_step": int(filter_run.num_measured[1:].min()),
        # Whether the filter's mean error exceeds odometry's there.
        "ekf_worse_in_first_5_steps": bool(
            estimate_m[_FIRST_STEPS].mean() > odometry_m[_FIRST_STEPS].mean()
        ),
    }


def _accepts_first_measurements(filter_run: FilterRun) -> bool | None:
    """None where no landmark was measured in the whole run."""
    measuring_steps = np.flatnonzero(filter_run.num_measured)
    return bool(filter_run.num_accepted[measuring_steps[0]]) if len(measuring_steps) else None


def _summary_statistics(values: Sequence[float | int | bool | None]) -> dict[str, Any] | None:
    """Statistics of the values that are not None; None where there is no value."""
    present = [float(value) for value in values if value is not None]
    if not present:
        return None
    p05, median, p95 = np.quantile(present, [0.05, 0.5, 0.95])
    return {
        "median": float(median),
        "mean": float(np.mean(present)),
        "p05": float(p05),
        "p95": float(p95),
        "count": len(present),
    }


def summarize_runs(filter_runs: Sequence[FilterRun]) -> dict[str, Any]:
    """Metrics of every run and their statistics, as for JSON."""
    runs = [_run_metrics(filter_run) for filter_run in filter_runs]
    keys = [key for key in runs[0] if key != "run"]
    statistics = {key: _summary_statistics([run[key] for run in runs]) for key in keys}
    return {"statistics": statistics, "runs": runs}


def error_quantiles(
    filter_runs: Sequence[FilterRun], *, of_odometry: bool
) -> np.ndarray[tuple[int, int]]:
    """(3, steps + 1) quantiles of 5 %, 50 % and 95 % of the position error in metres."""
    errors_m = [
        run.odometry_error_m if of_odometry else run.estimate_error_m for run in filter_runs
    ]
    # Quantiles, since locked-out runs lie far from the others and would dominate a deviation.
    quantiles: np.ndarray[tuple[int, int]] = np.quantile(
        np.array(errors_m), [0.05, 0.5, 0.95], axis=0
    )
    return quantiles


def median_run_index(filter_runs: Sequence[FilterRun]) -> int:
    """Index of the run with the median of the largest errors: the run to show."""
    order = np.argsort([run.estimate_error_m.max() for run in filter_runs])
    # Of an even number of runs the lower median, since no run lies between both.
    return int(order[(len(order) - 1) // 2])


# Range in metres and bearing in radians, or the errors of both.
RangeBearingPair = tuple[float, float]

# Within half a metre the number of pixels across a beacon changes by less than two.
_DISTANCE_BIN_M = 0.5


def compute_measurement_metrics(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> dict[str, object]:
    """Quantiles of range and bearing errors, and detection rates by distance, as for JSON."""
    errors = _all_errors(drive_logs, landmarks)
    # reshape keeps two columns even where no landmark was measured.
    range_errors_m, bearing_errors_rad = np.array(errors).reshape(-1, 2).T
    return {
        "measurements": len(errors),
        "range_error_m": _quantiles(range_errors_m),
        "bearing_error_deg": _quantiles(np.degrees(bearing_errors_rad)),
        "beacons_measured_by_distance": _detection_rates_by_distance(drive_logs, landmarks),
    }


def rms_errors(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> tuple[float, float]:
    """Root mean square errors of range in metres and bearing in degrees; nan for none."""
    range_m, bearing_rad = rms_range_bearing(_all_errors(drive_logs, landmarks))
    return range_m, math.degrees(bearing_rad)


def rms_range_bearing(errors: Sequence[RangeBearingPair]) -> RangeBearingPair:
    """Root mean square of pairs of errors; nan for none."""
    if not errors:
        return math.nan, math.nan
    range_m, bearing_rad = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(range_m), float(bearing_rad)


def detection_rate(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark], *, max_distance_m: float
) -> float:
    """Fraction of the beacons within a true distance that were measured; nan for none."""
    distance_m, is_measured = _beacon_distances(drive_logs, landmarks)
    near = is_measured[distance_m <= max_distance_m]
    return float(near.mean()) if len(near) else math.nan


def _detection_rates_by_distance(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> list[dict[str, float]]:
    """Detection rate of the beacons in each interval of true distance that has any."""
    distance_m, is_measured = _beacon_distances(drive_logs, landmarks)
    indices = (distance_m / _DISTANCE_BIN_M).astype(int)
    return [
        {
            "from_m": index * _DISTANCE_BIN_M,
            "to_m": (index + 1) * _DISTANCE_BIN_M,
            "rate": float(is_measured[indices == index].mean()),
        }
        for index in range(round(MAX_RANGE_M / _DISTANCE_BIN_M))
        if index in indices
    ]


def true_range_bearing(step: DriveStep, landmark: Landmark) -> RangeBearingPair:
    """True range and bearing of a landmark from the pose after a step."""
    dx, dy = landmark.x_m - step.truth.x_m, landmark.y_m - step.truth.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - step.truth.yaw_rad)


def _beacon_distances(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> tuple[Floats, Floats]:
    """(n,) true distances of every beacon in every step, and 1 where measured, otherwise 0."""
    # The start has no measurements and would count every beacon as missed.
    steps = [step for drive_log in drive_logs for step in drive_log.steps[1:]]
    beacons = [landmark for landmark in landmarks if landmark.kind == "beacon"]
    rows = [
        # By name: a landmark is measured at most once in a step.
        (true_range_bearing(step, one)[0], one.name in {m.name for m in step.measurements})
        for step in steps
        for one in beacons
    ]
    distance_m, is_measured = np.array(rows, dtype=np.float64).reshape(-1, 2).T
    return distance_m, is_measured


def _all_errors(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> list[RangeBearingPair]:
    """Errors of every measurement of every drive."""
    by_name = {landmark.name: landmark for landmark in landmarks}
    errors = []
    for step in (step for drive_log in drive_logs for step in drive_log.steps):
        for measurement in step.measurements:
            range_m, bearing_rad = true_range_bearing(step, by_name[measurement.name])
            bearing_error_rad = wrap_angle(measurement.bearing_rad - bearing_rad)
            errors.append((measurement.range_m - range_m, bearing_error_rad))
    return errors


def _quantiles(values: np.ndarray[tuple[int]]) -> dict[str, float]:
    if not len(values):
        # An empty object for none: quantiles of null would need a test each in every reader.
        return {}
    p05, median, p95 = np.quantile(values, [0.05, 0.5, 0.95])
    rms = float(np.sqrt(np.mean(np.square(values))))
    return {"p05": float(p05), "median": float(median), "p95": float(p95), "rms": rms}
