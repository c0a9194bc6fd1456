"""Wall times of a frame's stages."""

from __future__ import annotations

import time
from collections.abc import Callable


class StageClock:
    """Milliseconds by stage of one frame, from one mark to the next.

    `finish` waits until the device has done what it was told: without it OpenGL only queues, and
    the whole frame would be charged to the stage that reads it back. Waiting costs what the stages
    could have overlapped: nothing that can be measured on llvmpipe, which works off one target
    after the other (tests/measurements/raster_faces.py).
    """

    def __init__(self, wait_for_device: Callable[[], None]) -> None:
        self._finish = wait_for_device
        self._last = time.perf_counter()
        self.stage_ms: dict[str, float] = {}

    def end_stage(self, stage: str) -> None:
        """End a stage."""
        self._finish()
        now = time.perf_counter()
        self.stage_ms[stage] = 1e3 * (now - self._last)
        self._last = now
