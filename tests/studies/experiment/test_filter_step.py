"""One step of the filter: the start's error, the gate, and the same belief as the replay."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_client.localization import LandmarkPosition, OdometryPose
from catoptra_studies.experiment.drive_log import DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER, PAPER_FILTER
from catoptra_studies.experiment.localization_filter import advance_filter, begin_filter
from catoptra_studies.experiment.route import Waypoint

MAP = {"a": LandmarkPosition("a", 2.0, 0.0)}
START = DriveStep(Waypoint(0.0, 0.0, 0.0), OdometryPose(0.0, 0.0, 0.0), ())


def make_step(*measurements: LandmarkMeasurement) -> DriveStep:
    """Half a metre ahead, by odometry and in truth."""
    return DriveStep(Waypoint(0.5, 0.0, 0.0), OdometryPose(0.5, 0.0, 0.0), measurements)


def test_start_has_the_heading_error_in_the_mean_and_the_settings_variances():
    step = begin_filter(START, CONSISTENT_FILTER, heading_error_rad=0.1)
    np.testing.assert_allclose(step.belief.mean, [0.0, 0.0, 0.1])
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(step.belief.covariance)), [0.05, 0.05, math.radians(6.0)]
    )


def test_step_without_landmarks_follows_odometry_and_widens():
    start = begin_filter(START, PAPER_FILTER, heading_error_rad=0.0)
    step = advance_filter(start, make_step(), PAPER_FILTER, MAP)
    np.testing.assert_allclose(step.belief.mean, [0.5, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(step.odometry_pose, step.belief.mean)
    assert step.belief.covariance[0, 0] > 0.0
    assert step.updates == ()


def test_step_accepts_a_true_landmark_and_rejects_a_wrong_one():
    start = begin_filter(START, CONSISTENT_FILTER, heading_error_rad=0.0)
    measured = make_step(
        LandmarkMeasurement("a", 1.5, 0.0), LandmarkMeasurement("a", 1.5, math.radians(60.0))
    )
    step = advance_filter(start, measured, CONSISTENT_FILTER, MAP)
    assert [update.is_accepted for update in step.updates] == [True, False]
    assert step.belief.covariance[2, 2] < start.belief.covariance[2, 2]
    assert step.belief is step.updates[-1].belief


def test_belief_is_widened_after_five_rejecting_steps_if_the_filter_recovers():
    recovering = replace(CONSISTENT_FILTER, has_recovery=True)
    wrong = make_step(LandmarkMeasurement("a", 1.5, math.radians(60.0)))
    step = begin_filter(START, recovering, heading_error_rad=0.0)
    traces = []
    for _ in range(6):
        step = advance_filter(step, wrong, recovering, MAP)
        traces.append(float(np.trace(step.belief.covariance)))
    # 0.3 m squared for x and y, at the fifth step.
    assert traces[4] - traces[3] > 0.15
    assert traces[3] - traces[1] < 0.01
