"""When a plan is chosen again: after enough frames, and not for ever back and forth."""

from __future__ import annotations

from catoptra_server.planning.budget_monitor import (
    HYSTERESIS_FRAMES,
    WINDOW_FRAMES,
    BudgetMonitor,
    BudgetStatus,
)


def record_frames(
    monitor: BudgetMonitor, ms: float, frames: int, *, better_ms: float | None = None
) -> list[BudgetStatus]:
    return [monitor.record_frame(ms, better_plan_ms=better_ms) for _ in range(frames)]


def test_budget_when_kept_within_a_fifth_is_kept() -> None:
    assert set(record_frames(BudgetMonitor(10.0), 11.9, 1000, better_ms=14.0)) == {
        BudgetStatus.WITHIN_BUDGET
    }


def test_budget_when_exceeded_by_more_is_broken_after_thirty_frames() -> None:
    found = record_frames(BudgetMonitor(10.0), 12.1, WINDOW_FRAMES)
    assert found == [BudgetStatus.WITHIN_BUDGET] * (WINDOW_FRAMES - 1) + [BudgetStatus.OVER_BUDGET]


def test_budget_when_a_few_frames_take_long_is_kept() -> None:
    watch = BudgetMonitor(10.0)
    record_frames(watch, 9.0, 20)
    assert set(record_frames(watch, 50.0, 14)) == {BudgetStatus.WITHIN_BUDGET}


def test_room_when_there_is_for_long_is_told() -> None:
    found = record_frames(
        BudgetMonitor(10.0), 4.0, WINDOW_FRAMES - 1 + HYSTERESIS_FRAMES, better_ms=8.0
    )
    assert set(found[:-1]) == {BudgetStatus.WITHIN_BUDGET}
    assert found[-1] is BudgetStatus.HEADROOM


def test_room_when_what_is_better_would_nearly_fill_the_budget_is_none() -> None:
    assert BudgetStatus.HEADROOM not in record_frames(BudgetMonitor(10.0), 4.0, 2000, better_ms=8.6)


def test_room_when_it_was_a_mistake_is_waited_for_twice_as_long() -> None:
    watch = BudgetMonitor(10.0)
    watch.reset(BudgetStatus.HEADROOM)
    record_frames(watch, 20.0, WINDOW_FRAMES)
    watch.reset(BudgetStatus.OVER_BUDGET)
    found = record_frames(watch, 4.0, WINDOW_FRAMES - 1 + 2 * HYSTERESIS_FRAMES, better_ms=8.0)
    assert found.index(BudgetStatus.HEADROOM) == len(found) - 1


def test_watch_when_there_is_no_budget_still_knows_the_median() -> None:
    watch = BudgetMonitor(0.0)
    assert watch.median_ms is None
    assert set(record_frames(watch, 99.0, WINDOW_FRAMES)) == {BudgetStatus.WITHIN_BUDGET}
    assert watch.median_ms == 99.0
