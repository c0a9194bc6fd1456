"""Viewers' wheel commands take the robot, and give it back after three seconds of standing."""

from __future__ import annotations

from catoptra_studies.live.steering import (
    RESUME_AFTER_S,
    SharedControl,
    observe_speeds,
    record_command,
)

STANDING = (0.0, 0.0)
OWN = (2.0, 2.5)
FOREIGN = (1.0, -1.0)
DRIVING = record_command(SharedControl(), OWN)


def test_own_commands_are_not_foreign_even_if_the_state_is_older():
    control = record_command(DRIVING, (2.1, 2.4))
    for speeds in (OWN, (2.1, 2.4), STANDING, (2.0004, 2.5)):
        assert not observe_speeds(control, speeds, 0.0).is_foreign


def test_recent_commands_are_limited():
    control = DRIVING
    for number in range(100):
        control = record_command(control, (float(number), 1.0))
    assert len(control.recent_speeds) == 4
    assert observe_speeds(control, OWN, 0.0).is_foreign


def test_viewer_keeps_the_robot_while_driving_at_one_speed():
    control = DRIVING
    for time_s in range(100):
        control = observe_speeds(control, FOREIGN, float(time_s))
        assert control.is_foreign


def test_viewer_keeps_the_robot_until_three_seconds_after_the_stop():
    control = observe_speeds(DRIVING, FOREIGN, 10.0)
    control = observe_speeds(control, STANDING, 11.0)
    control = observe_speeds(control, STANDING, 11.0 + RESUME_AFTER_S - 0.1)
    assert control.is_foreign
    assert not observe_speeds(control, STANDING, 11.0 + RESUME_AFTER_S).is_foreign


def test_each_command_of_the_viewer_begins_the_wait_anew():
    control = observe_speeds(DRIVING, FOREIGN, 10.0)
    control = observe_speeds(control, STANDING, 11.0)
    control = observe_speeds(control, FOREIGN, 13.0)
    control = observe_speeds(control, STANDING, 13.5)
    assert observe_speeds(control, STANDING, 15.0).is_foreign


def test_stop_by_a_viewer_holds_a_driving_robot():
    driving = SharedControl()
    for number in range(4):
        driving = record_command(driving, (2.0 + number, 2.0))
    control = observe_speeds(driving, STANDING, 5.0)
    assert control.is_foreign
    assert not observe_speeds(control, STANDING, 5.0 + RESUME_AFTER_S).is_foreign
