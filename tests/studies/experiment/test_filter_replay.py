"""A filter over a made-up recording: perfect odometry and landmarks keep it at the truth."""

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
from catoptra_studies.experiment.filter_replay import (
    acceptance_rate,
    find_relock_step,
    replay_filter,
)
from catoptra_studies.experiment.route import clockwise_route

MAP = {"a": LandmarkPosition("a", 1.35, -1.9), "b": LandmarkPosition("b", -1.35, 1.9)}


def perfect_recording(*, seeing: bool = True) -> DriveLog:
    """Return the clockwise drive with odometry and landmarks that are exactly true."""
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
        steps.append(DriveStep(here, odometry, seen if seeing and len(steps) else ()))
    return DriveLog("real", 7, tuple(steps))


CERTAIN = replace(REAL, initial_heading_error_rad=0.0)


def test_replay_of_a_perfect_drive_stays_at_the_truth():
    trace = replay_filter(perfect_recording(), CERTAIN, PAPER_FILTER, MAP)
    assert trace.estimate_error_m.max() < 1e-9
    assert trace.odometry_error_m.max() < 1e-9
    assert acceptance_rate(trace, 1, 100) == 1.0


def test_replay_without_landmarks_equals_odometry():
    trace = replay_filter(perfect_recording(seeing=False), REAL, PAPER_FILTER, MAP)
    np.testing.assert_allclose(trace.estimate, trace.odometry, atol=1e-12)
    assert trace.odometry_error_m.max() > 0.3  # 5.2 degrees over 4.6 m
    assert acceptance_rate(trace, 1, 100) is None


def test_certain_filter_is_locked_out_and_recovers_if_it_may():
    wrong = replace(REAL, initial_heading_error_rad=math.radians(-12.0))
    locked = replay_filter(perfect_recording(), wrong, PAPER_FILTER, MAP)
    recovered = replay_filter(perfect_recording(), wrong, RECOVERING_FILTER, MAP)
    honest = replay_filter(perfect_recording(), wrong, CONSISTENT_FILTER, MAP)
    assert locked.rejection_streak.max() > 5
    assert recovered.rejection_streak.max() < 5
    assert recovered.estimate_error_m[60:].max() < 0.1
    assert honest.rejection_streak.max() == 0
    assert honest.windowed_nis.max() < 2.0 < locked.windowed_nis.max()


def test_timid_filter_stays_locked_out_unless_it_recovers():
    wrong = replace(REAL, initial_heading_error_rad=math.radians(-12.0))
    locked = replay_filter(perfect_recording(), wrong, OVERCONFIDENT_FILTER, MAP)
    unlocked = replay_filter(perfect_recording(), wrong, OVERCONFIDENT_RECOVERING_FILTER, MAP)
    assert locked.estimate_error_m[31:].max() > 0.25
    assert unlocked.estimate_error_m[31:].max() < 0.1


def test_replay_twice_gives_the_same_numbers():
    one, two = (replay_filter(perfect_recording(), REAL, PAPER_FILTER, MAP) for _ in range(2))
    assert np.array_equal(one.estimate, two.estimate)


@pytest.mark.parametrize(
    ("seen", "accepted", "expected"),
    [
        ([0, 1, 1, 1, 1, 1, 1], [0, 0, 0, 0, 0, 0, 1], 6),
        ([0, 1, 1, 1, 1, 0, 1, 1], [0, 0, 0, 0, 0, 0, 0, 1], 7),
        ([0, 1, 1, 1, 1, 1], [0, 0, 0, 0, 0, 1], None),
        ([0, 1, 1], [0, 1, 1], None),
    ],
    ids=["after five", "blind steps do not count", "after four", "no drought"],
)
def test_first_acceptance_after_drought(seen, accepted, expected):
    trace = replay_filter(perfect_recording(), CERTAIN, PAPER_FILTER, MAP)
    trace = replace(trace, num_measured=np.array(seen), num_accepted=np.array(accepted))
    assert find_relock_step(trace) == expected
