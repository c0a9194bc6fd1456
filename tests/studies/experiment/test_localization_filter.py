"""Steps of the filter, its replay over an invented drive, and its note for viewers."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.localization import LandmarkPosition, OdometryPose
from catoptra_protocol.notes import text_from_note
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, LandmarkMeasurement
from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    OVERCONFIDENT_FILTER,
    OVERCONFIDENT_RECOVERING_FILTER,
    PAPER_FILTER,
    REAL,
    RECOVERING_FILTER,
    FilterSettings,
)
from catoptra_studies.experiment.localization_filter import (
    NOTE_NAME,
    FilterRun,
    FilterStep,
    acceptance_rate,
    advance_filter,
    begin_filter,
    find_relock_step,
    note_from_filter_step,
    replay_filter,
)
from catoptra_studies.experiment.route import Waypoint, clockwise_route

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


FIELD_MAP = {"a": LandmarkPosition("a", 1.35, -1.9), "b": LandmarkPosition("b", -1.35, 1.9)}


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
            for name, mark in FIELD_MAP.items()
        )
        odometry = OdometryPose(dx, dy, here.yaw_rad)
        steps.append(DriveStep(here, odometry, seen if with_landmarks and len(steps) else ()))
    return DriveLog("real", 7, tuple(steps))


NO_ERROR_SETUP = replace(REAL, initial_heading_error_rad=0.0)


def test_replay_of_a_perfect_drive_stays_at_the_truth():
    run = replay_filter(make_perfect_log(), NO_ERROR_SETUP, PAPER_FILTER, FIELD_MAP)
    assert run.estimate_error_m.max() < 1e-9
    assert run.odometry_error_m.max() < 1e-9
    assert acceptance_rate(run, 1, 100) == 1.0


def test_replay_without_landmarks_equals_odometry():
    run = replay_filter(make_perfect_log(with_landmarks=False), REAL, PAPER_FILTER, FIELD_MAP)
    np.testing.assert_allclose(run.estimate, run.odometry, atol=1e-12)
    assert run.odometry_error_m.max() > 0.3  # 5.2 degrees over 4.6 m
    assert acceptance_rate(run, 1, 100) is None


def replay_wrong_start(settings: FilterSettings) -> FilterRun:
    wrong = replace(REAL, initial_heading_error_rad=math.radians(-12.0))
    return replay_filter(make_perfect_log(), wrong, settings, FIELD_MAP)


def test_filter_with_zero_covariance_is_locked_out_unless_it_recovers():
    locked, recovering, consistent = map(
        replay_wrong_start, (PAPER_FILTER, RECOVERING_FILTER, CONSISTENT_FILTER)
    )
    assert locked.rejection_streak.max() > 5
    assert recovering.rejection_streak.max() < 5
    assert recovering.estimate_error_m[60:].max() < 0.1
    assert consistent.rejection_streak.max() == 0
    assert consistent.windowed_nis.max() < 2.0 < locked.windowed_nis.max()


def test_overconfident_filter_stays_locked_out_unless_it_recovers():
    locked = replay_wrong_start(OVERCONFIDENT_FILTER)
    recovering = replay_wrong_start(OVERCONFIDENT_RECOVERING_FILTER)
    assert locked.estimate_error_m[31:].max() > 0.25
    assert recovering.estimate_error_m[31:].max() < 0.1


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
    run = replay_filter(make_perfect_log(), NO_ERROR_SETUP, PAPER_FILTER, FIELD_MAP)
    run = replace(run, num_measured=np.array(measured), num_accepted=np.array(accepted))
    assert find_relock_step(run) == expected


NOTE_MAP = {"a": LandmarkPosition("a", 2.0, 0.0), "b": LandmarkPosition("b", 0.0, 2.0)}


def make_filter_step() -> FilterStep:
    """A robot that stands 5 cm beside its belief and measures one landmark right, one wrong."""
    still = OdometryPose(0.0, 0.0, 0.0)
    start = DriveStep(Waypoint(0.0, 0.0, 0.0), still, ())
    measured = (LandmarkMeasurement("a", 2.0, 0.0), LandmarkMeasurement("b", 2.0, 0.0))
    step = DriveStep(Waypoint(0.03, 0.04, 0.0), still, measured)
    begun = begin_filter(start, CONSISTENT_FILTER, heading_error_rad=0.0)
    return advance_filter(begun, step, CONSISTENT_FILTER, NOTE_MAP)


def test_note_has_the_belief_the_gates_decisions_and_a_text():
    step = make_filter_step()
    note = json.loads(text_from_note(NOTE_NAME, note_from_filter_step(step)))
    assert note["pose"] == pytest.approx(step.belief.mean)
    assert note["covariance"] == pytest.approx(step.belief.covariance.ravel())
    assert note["detections"] == [
        {"landmark": "a", "bearing_rad": 0.0, "range_m": 2.0, "accepted": True},
        {"landmark": "b", "bearing_rad": 0.0, "range_m": 2.0, "accepted": False},
    ]
    assert note["text"].startswith("0.05 m from the truth, σ 0.0")
    assert note["text"].endswith("the gate accepts 1 of 2 landmarks")


def test_note_of_fifty_landmarks_is_accepted():
    step = make_filter_step()
    names = [f"a beacon with a long name {number}" for number in range(50)]
    measured = tuple(LandmarkMeasurement(name, math.pi, -math.e) for name in names)
    drive_step = replace(step.drive_step, measurements=measured)
    many = replace(step, drive_step=drive_step, updates=step.updates[:1] * 50)
    assert len(text_from_note(NOTE_NAME, note_from_filter_step(many))) > 4000
