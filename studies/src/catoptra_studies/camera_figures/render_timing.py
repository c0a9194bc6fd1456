"""Timing of several views in turn, so that a disturbance of the machine falls on all alike."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

# The first frames fill caches, raise the processor's clock and start software OpenGL's threads.
NUM_WARM_UP_ROUNDS = 3

# Render one frame of the given round and return the milliseconds of its stages.
DrawFunction = Callable[[int], Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class RenderTiming:
    """Time of one frame, in milliseconds; of several frames the medians."""

    wall_ms: float
    """Elapsed time."""

    cpu_ms: float
    """Time of all threads together: comparable even where other programs use the machine."""

    stage_ms: dict[str, float]
    """Elapsed time of each stage by name."""


@dataclass(frozen=True, slots=True)
class FrameRate:
    """One bar of the paper's Figure 10."""

    world: str
    renderer: str

    payload: str
    """Equipment of the robot: no camera, a mesh by its polygons, per pixel, or LMS200."""

    num_polygons: int
    """Polygons of the camera's mirror; 0 without a mesh."""

    fps: float
    wall_ms: float
    cpu_ms: float
    stage_ms: dict[str, float]


def time_round_robin(
    draw_functions: Sequence[DrawFunction], *, num_rounds: int, on_round: Callable[[], None]
) -> tuple[RenderTiming, ...]:
    """Time several functions in turn.

    Args:
        draw_functions: Functions to time; each is called once in every round.
        num_rounds: Rounds that count, after NUM_WARM_UP_ROUNDS others.
        on_round: Called after every round.

    Returns:
        The medians of each function.
    """
    timings: list[list[RenderTiming]] = [[] for _ in draw_functions]
    for number in range(NUM_WARM_UP_ROUNDS + num_rounds):
        # Interleaved, not one function after the other: processors slow down as they get warm.
        for index, draw in enumerate(draw_functions):
            timing = _time_once(draw, number)
            if number >= NUM_WARM_UP_ROUNDS:
                timings[index].append(timing)
        on_round()
    return tuple(_median_timing(rows) for rows in timings)


def _time_once(draw: DrawFunction, round_number: int) -> RenderTiming:
    # process_time counts all threads, those of Embree and llvmpipe included.
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    stage_ms = dict(draw(round_number))
    return RenderTiming(
        1e3 * (time.perf_counter() - wall_s), 1e3 * (time.process_time() - cpu_s), stage_ms
    )


def _median_timing(timings: Sequence[RenderTiming]) -> RenderTiming:
    # A mean would count every interruption of the process; the median ignores up to half of them.
    return RenderTiming(
        wall_ms=statistics.median(timing.wall_ms for timing in timings),
        cpu_ms=statistics.median(timing.cpu_ms for timing in timings),
        stage_ms={
            name: statistics.median(timing.stage_ms[name] for timing in timings)
            for name in timings[0].stage_ms
        },
    )
