"""What frames are worth, from drives and traces made by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from catoptra_client.localization import OdometryPose
from catoptra_protocol.landmarks import Landmark
from catoptra_studies.accuracy_cost.localization_accuracy import (
    localization_accuracy,
    summarise_localization,
)
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_runner import SetupResult
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.experiment.route import Waypoint

NEAR = Landmark("near", "beacon", 1.0, 0.0, 0.1, 0.1, 0.2, 0.4, "cyan", "magenta")
FAR = Landmark("far", "beacon", 0.0, 2.0, 0.1, 0.1, 0.2, 0.4, "magenta", "cyan")
HERE = DriveStep(Waypoint(0.0, 0.0, 0.0), OdometryPose(0.0, 0.0, 0.0), ())


def result(*seen: tuple[LandmarkMeasurement, ...]) -> SetupResult:
    steps = (HERE, *(DriveStep(HERE.truth, HERE.odometry, found) for found in seen))
    traces = {
        "paper": (trace([0.0, 0.1, 0.3]), trace([0.0, 0.2, 0.2]), trace([0.0, 0.9, 0.9])),
        "honest": (trace([0.0, 0.1, 0.1]),),
    }
    return SetupResult(SIM, (DriveLog("sim", 0, steps),), traces)


def trace(errors_m: list[float]) -> FilterRun:
    """Return as much of a trace as its worth is judged by; odometry is twice as far off."""
    errors = np.array(errors_m)
    known = SimpleNamespace(estimate_error_m=errors, odometry_error_m=2.0 * errors)
    return cast(FilterRun, known)


def test_row_has_shares_errors_and_medians_over_the_runs() -> None:
    seen = (LandmarkMeasurement("near", 1.03, math.radians(4.0)),)
    row = localization_accuracy("a step", result(seen, ()), (NEAR, FAR))
    assert row["step"] == "a step"
    assert row["frames"] == 2
    assert row["found_near"] == 0.5
    assert row["found"] == 0.25
    assert row["range_rms_m"] == pytest.approx(0.03)
    assert row["bearing_rms_deg"] == pytest.approx(4.0)
    assert row["ekf_mean_m"] == pytest.approx(0.2)  # of 0.2, 0.2 and 0.9
    assert row["ekf_max_m"] == pytest.approx(0.3)
    assert row["honest_ekf_mean_m"] == pytest.approx(0.1)


def test_row_when_nothing_was_seen_has_no_errors() -> None:
    row = localization_accuracy("blind", result(()), (NEAR,))
    assert (row["range_rms_m"], row["bearing_rms_deg"]) == (None, None)
    assert row["found"] == 0.0


def test_summary_tells_runs_steps_and_odometry_alone() -> None:
    told = summarise_localization([{"step": "a"}], result(()))
    assert told == {
        "runs": 3,
        "steps_a_run": 2,
        "odometry_max_m": pytest.approx(0.6),  # twice the median of 0.3, 0.2, 0.9
        "rows": [{"step": "a"}],
    }
