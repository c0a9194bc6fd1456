"""Times of several functions, called in turns, so that a disturbance affects all of them alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

WARM_UP = 3


def median_ms(
    draws: Mapping[str, Callable[[], object]], *, rounds: int
) -> dict[str, tuple[float, float]]:
    """Median milliseconds of each function: wall time, and processor time of all threads.

    On a machine with other load only the processor times are comparable.
    """
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in draws}
    for _ in range(WARM_UP + rounds):
        for name, draw in draws.items():
            begin = time.perf_counter(), time.process_time()
            draw()
            end = time.perf_counter(), time.process_time()
            times[name].append((1e3 * (end[0] - begin[0]), 1e3 * (end[1] - begin[1])))
    return {name: _medians(rows[WARM_UP:]) for name, rows in times.items()}


def _medians(rows: list[tuple[float, float]]) -> tuple[float, float]:
    wall, processors = zip(*rows, strict=True)
    return statistics.median(wall), statistics.median(processors)
