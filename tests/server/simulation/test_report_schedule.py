"""Due times of reports."""

from __future__ import annotations

from catoptra_server.simulation.robot import ReportSchedule


def test_reporters_when_just_made_are_due_at_once_and_then_by_their_periods() -> None:
    schedule = ReportSchedule([0.2, 0.5], 1.0)
    times = [1.0, 1.1, 1.2, 1.4, 1.5]
    assert [schedule.pop_due(t) for t in times] == [[0, 1], [], [0], [0], [1]]


def test_period_when_ticks_are_coarse_keeps_its_mean() -> None:
    schedule = ReportSchedule([0.05], 0.0)
    assert sum(bool(schedule.pop_due(0.02 * tick)) for tick in range(500)) == 200


def test_reporter_when_time_jumped_does_not_catch_up() -> None:
    schedule = ReportSchedule([0.2], 0.0)
    assert schedule.pop_due(10.0) == [0]
    assert schedule.pop_due(10.02) == [0]
    assert schedule.pop_due(10.04) == []
