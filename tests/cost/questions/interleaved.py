"""Times of several things, drawn in turns: what disturbs one then disturbs all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

WARM_UP = 3


def median_ms(draws: Mapping[str, Callable[[], object]], *, rounds: int) -> dict[str, float]:
    """Return the median milliseconds of each draw."""
    times: dict[str, list[float]] = {name: [] for name in draws}
    for _ in range(WARM_UP + rounds):
        for name, draw in draws.items():
            begin = time.perf_counter()
            draw()
            times[name].append(1e3 * (time.perf_counter() - begin))
    return {name: statistics.median(row[WARM_UP:]) for name, row in times.items()}
