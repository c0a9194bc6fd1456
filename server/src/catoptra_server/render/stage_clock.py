"""Wall times of the stages of a frame."""

from __future__ import annotations

import time
from collections.abc import Callable


class StageClock:
    """Milliseconds by stage of one frame, each from the end of the stage before.

    `wait_for_device` blocks until the device has finished all queued work: without this call OpenGL
    only queues, and the whole frame would be charged to the readback. Waiting costs as much as the
    stages could have overlapped: nothing measurable on llvmpipe, which finishes one target after
    the other (tests/measurements/raster_faces.py).
    """

    def __init__(self, wait_for_device: Callable[[], None]) -> None:
        self._finish = wait_for_device
        self._last = time.perf_counter()
        self.stage_ms: dict[str, float] = {}

    def end_stage(self, stage: str) -> None:
        """Charge the time since the last stage's end to a stage."""
        self._finish()
        # perf_counter: monotonic, and its resolution is far below a stage of a tenth of a
        # millisecond.
        now = time.perf_counter()
        self.stage_ms[stage] = 1e3 * (now - self._last)
        self._last = now
