"""Whether frames take as long as was predicted, and when a plan has to be chosen again.

A budget is broken when the median of 30 frames is more than a fifth above it. There is room when
the next better plan would take less than 0.85 of it, for many frames on end; each time a better
plan has to be given up again, twice as many are waited for. So a plan does not flap.
"""

from __future__ import annotations

import statistics
from collections import deque
from enum import Enum

WINDOW = 30
MOST_OVER = 1.2
ROOM = 0.85
# Frames with room before something better is tried; at most so many after setbacks.
PATIENCE = 300
_MOST_PATIENCE = 10_000


class Verdict(Enum):
    """What the last frames say of a plan."""

    KEPT = "kept"
    BROKEN = "broken"
    ROOM = "room"


class BudgetWatch:
    """The times of the frames of one camera and wish, over all the plans it has been drawn by."""

    def __init__(self, budget_ms: float) -> None:
        self._budget_ms = budget_ms
        self._times: deque[float] = deque(maxlen=WINDOW)
        self._with_room = 0
        self._patience = PATIENCE
        self._was_raised = False

    @property
    def median_ms(self) -> float | None:
        """Return the median of the last 30 frames; None before there were as many."""
        return statistics.median(self._times) if len(self._times) == WINDOW else None

    def note(self, ms: float, *, better_ms: float | None) -> Verdict:
        """Take note of a frame; `better_ms` is what the next better plan would take, corrected."""
        self._times.append(ms)
        median_ms = self.median_ms
        if median_ms is None or not self._budget_ms:
            return Verdict.KEPT
        if median_ms > MOST_OVER * self._budget_ms:
            return Verdict.BROKEN
        has_room = better_ms is not None and better_ms <= ROOM * self._budget_ms
        self._with_room = self._with_room + 1 if has_room else 0
        return Verdict.ROOM if self._with_room >= self._patience else Verdict.KEPT

    def replanned(self, verdict: Verdict) -> None:
        """Begin anew with another plan, chosen because of a verdict."""
        if verdict is Verdict.BROKEN and self._was_raised:
            self._patience = min(2 * self._patience, _MOST_PATIENCE)
        self._was_raised = verdict is Verdict.ROOM
        self._times.clear()
        self._with_room = 0
