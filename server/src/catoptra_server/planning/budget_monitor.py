"""Monitor of frame times against a budget: when a plan has to be chosen again.

A budget is exceeded when the median of 30 frames is more than a fifth above. There is headroom when
the next more accurate plan would take less than 0.85 of the budget, for many frames on end; each
time a more accurate plan turns out too slow, the wait doubles. So plans do not oscillate.
"""

from __future__ import annotations

import statistics
from collections import deque
from enum import Enum

# A second at 30 Hz: long enough for a stable median, short enough to react.
WINDOW_FRAMES = 30
OVERRUN_FACTOR = 1.2
HEADROOM_FRACTION = 0.85
# Frames with headroom before a more accurate plan is tried, and the limit after setbacks: ten
# seconds at 30 Hz, and some five minutes.
HYSTERESIS_FRAMES = 300
_MAX_HYSTERESIS_FRAMES = 10_000


class BudgetStatus(Enum):
    """Frame times of a plan in relation to the budget."""

    WITHIN_BUDGET = "within budget"
    OVER_BUDGET = "over budget"
    HEADROOM = "headroom"


class BudgetMonitor:
    """Frame times of one camera, across all plans of its budget."""

    def __init__(self, budget_ms: float) -> None:
        self._budget_ms = budget_ms
        self._frame_times_ms: deque[float] = deque(maxlen=WINDOW_FRAMES)
        self._added_ms: deque[float] = deque(maxlen=WINDOW_FRAMES)
        self._frames_with_headroom = 0
        self._hysteresis_frames = HYSTERESIS_FRAMES
        self._was_upgraded = False

    @property
    def median_ms(self) -> float | None:
        """Median of the last 30 frames; None before as many."""
        return (
            statistics.median(self._frame_times_ms)
            if len(self._frame_times_ms) == WINDOW_FRAMES
            else None
        )

    @property
    def median_added_ms(self) -> float:
        """Median of the times in these frames that the cost model has not; 0 before a frame."""
        return statistics.median(self._added_ms) if self._added_ms else 0.0

    def record_frame(
        self, frame_ms: float, *, better_plan_ms: float | None, added_ms: float = 0.0
    ) -> BudgetStatus:
        """Record a frame.

        Args:
            frame_ms: Wall time of the frame.
            added_ms: Part of it that the cost model has not, such as effects.
            better_plan_ms: Predicted time of the next more accurate plan, corrected; None without
                one.
        """
        self._frame_times_ms.append(frame_ms)
        self._added_ms.append(added_ms)
        # Most cameras have no budget; the median took 0.02 ms of each of their frames.
        median_ms = self.median_ms if self._budget_ms else None
        if median_ms is None:
            return BudgetStatus.WITHIN_BUDGET
        # The median, not the mean: a single slow frame, such as a page fault, decides nothing.
        if median_ms > OVERRUN_FACTOR * self._budget_ms:
            return BudgetStatus.OVER_BUDGET
        has_headroom = (
            better_plan_ms is not None and better_plan_ms <= HEADROOM_FRACTION * self._budget_ms
        )
        self._frames_with_headroom = self._frames_with_headroom + 1 if has_headroom else 0
        return (
            BudgetStatus.HEADROOM
            if self._frames_with_headroom >= self._hysteresis_frames
            else BudgetStatus.WITHIN_BUDGET
        )

    def reset(self, status: BudgetStatus) -> None:
        """Start over with another plan, chosen because of a status."""
        # Only an overrun right after an upgrade is a mistake of the upgrade; other overruns come
        # from the scene or from load.
        if status is BudgetStatus.OVER_BUDGET and self._was_upgraded:
            self._hysteresis_frames = min(2 * self._hysteresis_frames, _MAX_HYSTERESIS_FRAMES)
        self._was_upgraded = status is BudgetStatus.HEADROOM
        self._frame_times_ms.clear()
        self._added_ms.clear()
        self._frames_with_headroom = 0
