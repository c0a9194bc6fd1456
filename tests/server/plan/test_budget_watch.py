"""When a plan is chosen again: after enough frames, and not for ever back and forth."""

from __future__ import annotations

from catoptra_server.plan.budget_watch import PATIENCE, WINDOW, BudgetWatch, Verdict


def verdicts(
    watch: BudgetWatch, ms: float, frames: int, *, better_ms: float | None = None
) -> list[Verdict]:
    return [watch.note(ms, better_ms=better_ms) for _ in range(frames)]


def test_budget_when_kept_within_a_fifth_is_kept() -> None:
    assert set(verdicts(BudgetWatch(10.0), 11.9, 1000, better_ms=14.0)) == {Verdict.KEPT}


def test_budget_when_exceeded_by_more_is_broken_after_thirty_frames() -> None:
    found = verdicts(BudgetWatch(10.0), 12.1, WINDOW)
    assert found == [Verdict.KEPT] * (WINDOW - 1) + [Verdict.BROKEN]


def test_budget_when_a_few_frames_take_long_is_kept() -> None:
    watch = BudgetWatch(10.0)
    verdicts(watch, 9.0, 20)
    assert set(verdicts(watch, 50.0, 14)) == {Verdict.KEPT}


def test_room_when_there_is_for_long_is_told() -> None:
    found = verdicts(BudgetWatch(10.0), 4.0, WINDOW - 1 + PATIENCE, better_ms=8.0)
    assert set(found[:-1]) == {Verdict.KEPT}
    assert found[-1] is Verdict.ROOM


def test_room_when_what_is_better_would_nearly_fill_the_budget_is_none() -> None:
    assert Verdict.ROOM not in verdicts(BudgetWatch(10.0), 4.0, 2000, better_ms=8.6)


def test_room_when_it_was_a_mistake_is_waited_for_twice_as_long() -> None:
    watch = BudgetWatch(10.0)
    watch.replanned(Verdict.ROOM)
    verdicts(watch, 20.0, WINDOW)
    watch.replanned(Verdict.BROKEN)
    found = verdicts(watch, 4.0, WINDOW - 1 + 2 * PATIENCE, better_ms=8.0)
    assert found.index(Verdict.ROOM) == len(found) - 1


def test_watch_when_there_is_no_budget_still_knows_the_median() -> None:
    watch = BudgetWatch(0.0)
    assert watch.median_ms is None
    assert set(verdicts(watch, 99.0, WINDOW)) == {Verdict.KEPT}
    assert watch.median_ms == 99.0
