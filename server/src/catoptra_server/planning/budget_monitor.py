"""Whether frames take as long as was predicted, and when a plan has to be chosen again.

A budget is broken when the median of 30 frames is more than a fifth above it. There is room when
the next better plan would take less than 0.85 of it, for many frames on end; each time a better
plan has to be given up again, twice as many are waited for. So a plan does not flap.
"""

from __future__ import annotations

import statistics
from collections import deque
from enum import Enum

WINDOW_FRAMES = 30
OVERRUN_FACTOR = 1.2
HEADROOM_FRACTION = 0.85
# Frames with room before something better is tried; at most so many after setbacks.
HYSTERESIS_FRAMES = 300
_MAX_HYSTERESIS_FRAMES = 10_000


class BudgetStatus(Enum):
    """What the last frames say of a plan."""

    WITHIN_BUDGET = "kept"
    OVER_BUDGET = "broken"
    HEADROOM = "room"


class BudgetMonitor:
    """The times of the frames of one camera and wish, over all the plans it has been drawn by."""

    def __init__(self, budget_ms: float) -> None:
        self._budget_ms = budget_ms
        self._frame_times_ms: deque[float] = deque(maxlen=WINDOW_FRAMES)
        self._frames_with_headroom = 0
        self._hysteresis_frames = HYSTERESIS_FRAMES
        self._was_upgraded = False

    @property
    def median_ms(self) -> float | None:
        """Return the median of the last 30 frames; None before there were as many."""
        return (
            statistics.median(self._frame_times_ms)
            if len(self._frame_times_ms) == WINDOW_FRAMES
            else None
        )

    def record_frame(self, frame_ms: float, *, better_plan_ms: float | None) -> BudgetStatus:
        """Take note of a frame; `better_ms` is what the next better plan would take, corrected."""
        self._frame_times_ms.append(frame_ms)
        median_ms = self.median_ms
        if median_ms is None or not self._budget_ms:
            return BudgetStatus.WITHIN_BUDGET
        if median_ms > OVERRUN_FACTOR * self._budget_ms:
            return BudgetStatus.OVER_BUDGET
        has_room = (
            better_plan_ms is not None and better_plan_ms <= HEADROOM_FRACTION * self._budget_ms
        )
        self._frames_with_headroom = self._frames_with_headroom + 1 if has_room else 0
        return (
            BudgetStatus.HEADROOM
            if self._frames_with_headroom >= self._hysteresis_frames
            else BudgetStatus.WITHIN_BUDGET
        )

    def reset(self, status: BudgetStatus) -> None:
        """Begin anew with another plan, chosen because of a verdict."""
        if status is BudgetStatus.OVER_BUDGET and self._was_upgraded:
            self._hysteresis_frames = min(2 * self._hysteresis_frames, _MAX_HYSTERESIS_FRAMES)
        self._was_upgraded = status is BudgetStatus.HEADROOM
        self._frame_times_ms.clear()
        self._frames_with_headroom = 0
