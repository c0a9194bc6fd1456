"""Odometry between readings: on the line between two of them, never after the newest."""

from __future__ import annotations

import math

import pytest

from catoptra_client.localization import OdometryPose
from catoptra_studies.live.live_localizer import TimedOdometry, interpolate_odometry

READINGS = (
    TimedOdometry(1.0, OdometryPose(0.0, 0.0, 3.0)),
    TimedOdometry(1.2, OdometryPose(0.2, -0.1, -3.0)),
    TimedOdometry(1.4, OdometryPose(0.4, 0.0, -2.9)),
)


@pytest.mark.parametrize(
    ("time_s", "expected"),
    [
        (0.5, READINGS[0].pose),
        (1.0, READINGS[0].pose),
        (1.2, READINGS[1].pose),
        (1.25, OdometryPose(0.25, -0.075, -2.975)),
        (1.4, READINGS[2].pose),
    ],
    ids=["before the oldest", "oldest", "at a reading", "between", "newest"],
)
def test_odometry_at_a_time(time_s, expected):
    pose = interpolate_odometry(READINGS, time_s)
    assert pose is not None
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx(
        (expected.x_m, expected.y_m, expected.yaw_rad)
    )


def test_yaw_turns_by_the_shorter_direction():
    pose = interpolate_odometry(READINGS, 1.1)
    assert pose is not None
    # From 3 rad across pi to -3 rad.
    assert abs(pose.yaw_rad) == pytest.approx(math.pi, abs=1e-6)


def test_time_after_the_newest_reading_has_no_odometry():
    assert interpolate_odometry(READINGS, 1.41) is None
    assert interpolate_odometry((), 1.0) is None
