"""Frames of several views drawn in turns, and what they took: what disturbs one disturbs all."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

# Caches, the clock of the processor, and software OpenGL's threads are not steady before.
NUM_WARM_UP_ROUNDS = 3

DrawFunction = Callable[[int], Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class RenderTiming:
    """Medians in milliseconds: on the wall, of all processors together, and of each stage.

    Where others use the machine too, the second is what can be compared.
    """

    wall_ms: float
    cpu_ms: float
    stage_ms: dict[str, float]


def time_round_robin(
    draw_functions: Sequence[DrawFunction], *, num_rounds: int, on_round: Callable[[], None]
) -> tuple[RenderTiming, ...]:
    """Return what each took; it is called with the round's number and returns its stages' ms."""
    taken: list[list[RenderTiming]] = [[] for _ in draw_functions]
    for number in range(NUM_WARM_UP_ROUNDS + num_rounds):
        for index, draw in enumerate(draw_functions):
            once = _time_once(draw, number)
            if number >= NUM_WARM_UP_ROUNDS:
                taken[index].append(once)
        on_round()
    return tuple(_median_timing(rows) for rows in taken)


def _time_once(draw: DrawFunction, round_number: int) -> RenderTiming:
    wall, processors = time.perf_counter(), time.process_time()
    stages = draw(round_number)
    return RenderTiming(
        1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processors), dict(stages)
    )


def _median_timing(timings: Sequence[RenderTiming]) -> RenderTiming:
    return RenderTiming(
        wall_ms=statistics.median(row.wall_ms for row in timings),
        cpu_ms=statistics.median(row.cpu_ms for row in timings),
        stage_ms={
            name: statistics.median(row.stage_ms[name] for row in timings)
            for name in timings[0].stage_ms
        },
    )
