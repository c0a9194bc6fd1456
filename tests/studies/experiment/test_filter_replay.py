"""A filter over an invented drive: perfect odometry and landmarks keep it at the truth."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.localization import LandmarkPosition, OdometryPose
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    OVERCONFIDENT_FILTER,
    OVERCONFIDENT_RECOVERING_FILTER,
    PAPER_FILTER,
    REAL,
    RECOVERING_FILTER,
)
from catoptra_studies.experiment.localization_filter import (
    acceptance_rate,
    find_relock_step,
    replay_filter,
)
from catoptra_studies.experiment.route import clockwise_route

MAP = {"a": LandmarkPosition("a", 1.35, -1.9), "b": LandmarkPosition("b", -1.35, 1.9)}


def make_perfect_log(*, with_landmarks: bool = True) -> DriveLog:
    """The clockwise drive with exact odometry and measurements."""
    start = clockwise_route()[0]
    steps = []
    for here in clockwise_route():
        dx, dy = here.x_m - start.x_m, here.y_m - start.y_m  # the start's yaw is 0
        seen = tuple(
            LandmarkMeasurement(
                name,
                math.hypot(mark.x_m - here.x_m, mark.y_m - here.y_m),
                wrap_angle(math.atan2(mark.y_m - here.y_m, mark.x_m - here.x_m) - here.yaw_rad),
            )
            for name, mark in MAP.items()
        )
        odometry = OdometryPose(dx, dy, here.yaw_rad)
        steps.append(DriveStep(here, odometry, seen if with_landmarks and len(steps) else ()))
    return DriveLog("real", 7, tuple(steps))


NO_ERROR_SETUP = replace(REAL, initial_heading_error_rad=0.0)


def test_replay_of_a_perfect_drive_stays_at_the_truth():
    run = replay_filter(make_perfect_log(), NO_ERROR_SETUP, PAPER_FILTER, MAP)
    assert run.estimate_error_m.max() < 1e-9
    assert run.odometry_error_m.max() < 1e-9
    assert acceptance_rate(run, 1, 100) == 1.0


def test_replay_without_landmarks_equals_odometry():
    run = replay_filter(make_perfect_log(with_landmarks=False), REAL, PAPER_FILTER, MAP)
    np.testing.assert_allclose(run.estimate, run.odometry, atol=1e-12)
    assert run.odometry_error_m.max() > 0.3  # 5.2 degrees over 4.6 m
    assert acceptance_rate(run, 1, 100) is None


def test_filter_with_zero_covariance_is_locked_out_unless_it_recovers():
    wrong = replace(REAL, initial_heading_error_rad=math.radians(-12.0))
    locked = replay_filter(make_perfect_log(), wrong, PAPER_FILTER, MAP)
    recovering = replay_filter(make_perfect_log(), wrong, RECOVERING_FILTER, MAP)
    consistent = replay_filter(make_perfect_log(), wrong, CONSISTENT_FILTER, MAP)
    assert locked.rejection_streak.max() > 5
    assert recovering.rejection_streak.max() < 5
    assert recovering.estimate_error_m[60:].max() < 0.1
    assert consistent.rejection_streak.max() == 0
    assert consistent.windowed_nis.max() < 2.0 < locked.windowed_nis.max()


def test_overconfident_filter_stays_locked_out_unless_it_recovers():
    wrong = replace(REAL, initial_heading_error_rad=math.radians(-12.0))
    locked = replay_filter(make_perfect_log(), wrong, OVERCONFIDENT_FILTER, MAP)
    recovering = replay_filter(make_perfect_log(), wrong, OVERCONFIDENT_RECOVERING_FILTER, MAP)
    assert locked.estimate_error_m[31:].max() > 0.25
    assert recovering.estimate_error_m[31:].max() < 0.1


def test_replay_twice_gives_the_same_numbers():
    one, two = (replay_filter(make_perfect_log(), REAL, PAPER_FILTER, MAP) for _ in range(2))
    assert np.array_equal(one.estimate, two.estimate)


@pytest.mark.parametrize(
    ("measured", "accepted", "expected"),
    [
        ([0, 1, 1, 1, 1, 1, 1], [0, 0, 0, 0, 0, 0, 1], 6),
        ([0, 1, 1, 1, 1, 0, 1, 1], [0, 0, 0, 0, 0, 0, 0, 1], 7),
        ([0, 1, 1, 1, 1, 1], [0, 0, 0, 0, 0, 1], None),
        ([0, 1, 1], [0, 1, 1], None),
    ],
    ids=["after five", "steps without landmarks do not count", "after four", "no streak"],
)
def test_relock_is_the_first_acceptance_after_a_streak(measured, accepted, expected):
    run = replay_filter(make_perfect_log(), NO_ERROR_SETUP, PAPER_FILTER, MAP)
    run = replace(run, num_measured=np.array(measured), num_accepted=np.array(accepted))
    assert find_relock_step(run) == expected
