"""Statistics over many runs and the run to show; measurement errors against a made truth."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catoptra_client.localization import OdometryPose
from catoptra_protocol.landmarks import Landmark
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.metrics import (
    compute_measurement_metrics,
    detection_rate,
    error_quantiles,
    median_run_index,
    rms_errors,
    summarize_runs,
)
from catoptra_studies.experiment.route import Waypoint

STEPS = 101


def make_filter_run(run: int, *, largest_m: float) -> FilterRun:
    """A run whose filter error rises to a maximum, with twice the error of odometry."""
    error = np.linspace(0.0, largest_m, STEPS)
    ones = np.ones(STEPS, dtype=np.int64)
    poses = np.zeros((STEPS, 3))
    return FilterRun(
        "paper", run, poses, poses, error, 2.0 * error, ones, ones, 0 * ones, 0.5 * error
    )


def run_metrics(filter_run: FilterRun) -> dict[str, Any]:
    return summarize_runs([filter_run])["runs"][0]


def test_run_metrics_count_the_steps_above_a_metre():
    metrics = run_metrics(make_filter_run(0, largest_m=1.0))
    assert metrics["odometry_max_m"] == 2.0
    assert metrics["odometry_steps_above_1m"] == 50  # 2 k / 100 > 1 from k = 51 on
    assert metrics["ekf_max_m"] == 1.0
    assert metrics["windowed_nis_max"] == 0.5
    assert metrics["accepted_steps_9_to_22"] == 1.0
    assert metrics["relock_step"] is None
    assert not metrics["ekf_worse_in_first_5_steps"]


def test_rate_of_steps_without_landmarks_is_missing_and_not_in_the_statistics():
    run = make_filter_run(0, largest_m=1.0)
    blind = replace(run, num_measured=np.zeros(STEPS, dtype=np.int64))
    assert run_metrics(blind)["accepted_steps_1_to_22"] is None
    assert run_metrics(blind)["accepts_first_measurements"] is None
    assert summarize_runs([blind])["statistics"]["accepted_steps_1_to_22"] is None
    found = summarize_runs([run, blind])["statistics"]["accepted_steps_1_to_22"]
    assert (found["median"], found["mean"], found["count"]) == (1.0, 1.0, 1)


def test_median_run_has_the_median_largest_error():
    runs = [make_filter_run(seed, largest_m=m) for seed, m in enumerate([0.9, 0.1, 0.5])]
    assert runs[median_run_index(runs)].run == 2


def test_summary_has_every_run_and_statistics():
    found = summarize_runs([make_filter_run(seed, largest_m=0.1 * (seed + 1)) for seed in range(3)])
    assert [run["run"] for run in found["runs"]] == [0, 1, 2]
    statistics = found["statistics"]["ekf_max_m"]
    assert (statistics["median"], statistics["mean"]) == pytest.approx((0.2, 0.2))
    assert (statistics["p05"], statistics["p95"]) == pytest.approx((0.11, 0.29))


def test_error_bands_enclose_the_median():
    runs = [make_filter_run(seed, largest_m=0.1 * seed) for seed in range(11)]
    low, median, high = error_quantiles(runs, of_odometry=False)
    assert (low <= median).all()
    assert (median <= high).all()
    assert median[-1] == pytest.approx(0.5)


BEACON = Landmark("b", "beacon", 1.2, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
HERE = Waypoint(0.0, 0.0, math.pi / 2)
NO_ODOMETRY = OdometryPose(0.0, 0.0, 0.0)


def make_log(*measurements: tuple[LandmarkMeasurement, ...]) -> DriveLog:
    steps = (
        DriveStep(HERE, NO_ODOMETRY, ()),
        *(DriveStep(HERE, NO_ODOMETRY, found) for found in measurements),
    )
    return DriveLog("sim", 0, steps)


def test_errors_are_measured_minus_true_and_wrapped():
    found = make_log((LandmarkMeasurement("b", 1.25, math.radians(-91.0)),))
    metrics = compute_measurement_metrics([found], [BEACON])
    assert metrics["range_error_m"]["median"] == pytest.approx(0.05)
    assert metrics["bearing_error_deg"]["median"] == pytest.approx(-1.0)


def test_detection_rate_counts_the_steps_after_the_start():
    found = make_log((LandmarkMeasurement("b", 1.2, -math.pi / 2),), ())
    metrics = compute_measurement_metrics([found], [BEACON])
    assert metrics["beacons_measured_by_distance"] == [{"from_m": 1.0, "to_m": 1.5, "rate": 0.5}]


def test_nothing_measured_has_no_error():
    assert compute_measurement_metrics([make_log(())], [BEACON])["range_error_m"] == {}


def test_rms_errors_are_of_range_and_bearing_and_nan_of_nothing():
    found = make_log(
        (LandmarkMeasurement("b", 1.23, math.radians(-93.0)),),
        (LandmarkMeasurement("b", 1.16, -math.pi / 2),),
    )
    assert rms_errors([found], [BEACON]) == pytest.approx((math.sqrt(0.00125), math.sqrt(4.5)))
    assert all(math.isnan(error) for error in rms_errors([make_log(())], [BEACON]))


def test_detection_rate_counts_beacons_within_the_distance_alone():
    found = make_log((LandmarkMeasurement("b", 1.2, 0.0),), ())
    assert detection_rate([found], [BEACON], max_distance_m=1.2) == 0.5
    assert math.isnan(detection_rate([found], [BEACON], max_distance_m=1.1))
