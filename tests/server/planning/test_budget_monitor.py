"""When a plan is chosen anew: after enough frames, and without oscillation."""

from __future__ import annotations

from catoptra_server.frames.plan.planner import (
    HYSTERESIS_FRAMES,
    WINDOW_FRAMES,
    BudgetMonitor,
    BudgetStatus,
)


def record_frames(
    monitor: BudgetMonitor, ms: float, frames: int, *, better_ms: float | None = None
) -> list[BudgetStatus]:
    return [monitor.record_frame(ms, better_plan_ms=better_ms) for _ in range(frames)]


def test_overrun_within_a_fifth_stays_within_budget() -> None:
    assert set(record_frames(BudgetMonitor(10.0), 11.9, 1000, better_ms=14.0)) == {
        BudgetStatus.WITHIN_BUDGET
    }


def test_larger_overrun_is_reported_after_thirty_frames() -> None:
    found = record_frames(BudgetMonitor(10.0), 12.1, WINDOW_FRAMES)
    assert found == [BudgetStatus.WITHIN_BUDGET] * (WINDOW_FRAMES - 1) + [BudgetStatus.OVER_BUDGET]


def test_few_slow_frames_stay_within_budget() -> None:
    watch = BudgetMonitor(10.0)
    record_frames(watch, 9.0, 20)
    assert set(record_frames(watch, 50.0, 14)) == {BudgetStatus.WITHIN_BUDGET}


def test_lasting_headroom_is_reported() -> None:
    found = record_frames(
        BudgetMonitor(10.0), 4.0, WINDOW_FRAMES - 1 + HYSTERESIS_FRAMES, better_ms=8.0
    )
    assert set(found[:-1]) == {BudgetStatus.WITHIN_BUDGET}
    assert found[-1] is BudgetStatus.HEADROOM


def test_better_plan_that_nearly_fills_the_budget_is_no_headroom() -> None:
    assert BudgetStatus.HEADROOM not in record_frames(BudgetMonitor(10.0), 4.0, 2000, better_ms=8.6)


def test_wait_for_headroom_doubles_after_a_mistake() -> None:
    watch = BudgetMonitor(10.0)
    watch.reset(BudgetStatus.HEADROOM)
    record_frames(watch, 20.0, WINDOW_FRAMES)
    watch.reset(BudgetStatus.OVER_BUDGET)
    found = record_frames(watch, 4.0, WINDOW_FRAMES - 1 + 2 * HYSTERESIS_FRAMES, better_ms=8.0)
    assert found.index(BudgetStatus.HEADROOM) == len(found) - 1


def test_monitor_without_a_budget_has_a_median() -> None:
    watch = BudgetMonitor(0.0)
    assert watch.median_ms is None
    assert set(record_frames(watch, 99.0, WINDOW_FRAMES)) == {BudgetStatus.WITHIN_BUDGET}
    assert watch.median_ms == 99.0


def test_added_times_have_a_median_of_their_own() -> None:
    monitor = BudgetMonitor(10.0)
    assert monitor.median_added_ms == 0.0
    for added_ms in (1.0, 2.0, 9.0):
        monitor.record_frame(20.0, better_plan_ms=None, added_ms=added_ms)
    assert monitor.median_added_ms == 2.0
    monitor.reset(BudgetStatus.WITHIN_BUDGET)
    assert monitor.median_added_ms == 0.0
