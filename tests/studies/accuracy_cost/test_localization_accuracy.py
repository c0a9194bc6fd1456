"""Rates and errors of one level, from drives and filter runs made by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from catoptra_client.localization import OdometryPose
from catoptra_protocol.landmarks import Landmark
from catoptra_studies.accuracy_cost.localization_study import (
    localization_row,
    summarize_localization,
)
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_runner import SetupResult
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.route import Waypoint

NEAR = Landmark("near", "beacon", 1.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
FAR = Landmark("far", "beacon", 0.0, 2.0, 0.1, 0.1, 0.2, 0.4, "magenta", "cyan")
HERE = DriveStep(Waypoint(0.0, 0.0, 0.0), OdometryPose(0.0, 0.0, 0.0), ())


def make_result(*measurements: tuple[LandmarkMeasurement, ...]) -> SetupResult:
    steps = (HERE, *(DriveStep(HERE.truth, HERE.odometry, found) for found in measurements))
    traces = {
        "paper": (
            make_filter_run([0.0, 0.1, 0.3]),
            make_filter_run([0.0, 0.2, 0.2]),
            make_filter_run([0.0, 0.9, 0.9]),
        ),
        "consistent": (make_filter_run([0.0, 0.1, 0.1]),),
    }
    return SetupResult(SIM, (DriveLog("sim", 0, steps),), traces)


def make_filter_run(errors_m: list[float]) -> FilterRun:
    """The fields of a run that the row needs; odometry has twice the error."""
    errors = np.array(errors_m)
    known = SimpleNamespace(estimate_error_m=errors, odometry_error_m=2.0 * errors)
    return cast(FilterRun, known)


def test_row_has_rates_errors_and_medians_over_the_runs() -> None:
    seen = (LandmarkMeasurement("near", 1.03, math.radians(4.0)),)
    row = localization_row("a step", make_result(seen, ()), (NEAR, FAR))
    assert row.level == "a step"
    assert row.num_frames == 2
    assert row.near_detection_rate == 0.5
    assert row.detection_rate == 0.25
    assert row.range_rms_m == pytest.approx(0.03)
    assert row.bearing_rms_deg == pytest.approx(4.0)
    assert row.ekf_mean_m == pytest.approx(0.2)  # of 0.2, 0.2 and 0.9
    assert row.ekf_max_m == pytest.approx(0.3)
    assert row.consistent_ekf_mean_m == pytest.approx(0.1)


def test_row_when_nothing_was_measured_has_nan_errors() -> None:
    row = localization_row("blind", make_result(()), (NEAR,))
    assert math.isnan(row.range_rms_m)
    assert math.isnan(row.bearing_rms_deg)
    assert row.detection_rate == 0.0


def test_summary_has_runs_steps_and_odometry_alone() -> None:
    row = localization_row("a level", make_result(()), (NEAR,))
    summary = summarize_localization([row], make_result(()))
    assert (summary.num_runs, summary.steps_per_run) == (3, 2)
    assert summary.odometry_max_m == pytest.approx(0.6)  # twice the median of 0.3, 0.2, 0.9
    assert summary.rows == (row,)
