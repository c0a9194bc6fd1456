"""Measurement errors and detection rates against a truth made by hand."""

from __future__ import annotations

import math

import pytest

from catoptra_client.localization import OdometryPose
from catoptra_protocol.landmarks import Landmark
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.metrics import (
    compute_measurement_metrics,
    detection_rate,
    detection_rates_by_distance,
    rms_errors,
)
from catoptra_studies.experiment.route import Waypoint

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
    assert detection_rates_by_distance([found], [BEACON]) == [
        {"from_m": 1.0, "to_m": 1.5, "rate": 0.5}
    ]


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
