"""Frames of several views drawn in turns, and what they took: what disturbs one disturbs all."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

# Caches, the clock of the processor, and software OpenGL's threads are not steady before.
WARM_UP_ROUNDS = 3

Draw = Callable[[int], Mapping[str, float]]


@dataclass(frozen=True, slots=True)
class Took:
    """Medians in milliseconds: on the wall, of all processors together, and of each stage.

    Where others use the machine too, the second is what can be compared.
    """

    ms: float
    processor_ms: float
    stage_ms: dict[str, float]


def in_turns(
    draws: Sequence[Draw], *, rounds: int, on_round: Callable[[], None]
) -> tuple[Took, ...]:
    """Return what each took; it is called with the round's number and returns its stages' ms."""
    taken: list[list[Took]] = [[] for _ in draws]
    for number in range(WARM_UP_ROUNDS + rounds):
        for index, draw in enumerate(draws):
            once = _once(draw, number)
            if number >= WARM_UP_ROUNDS:
                taken[index].append(once)
        on_round()
    return tuple(_medians(rows) for rows in taken)


def _once(draw: Draw, number: int) -> Took:
    wall, processors = time.perf_counter(), time.process_time()
    stages = draw(number)
    return Took(
        1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - processors), dict(stages)
    )


def _medians(rows: Sequence[Took]) -> Took:
    return Took(
        ms=statistics.median(row.ms for row in rows),
        processor_ms=statistics.median(row.processor_ms for row in rows),
        stage_ms={
            name: statistics.median(row.stage_ms[name] for row in rows) for name in rows[0].stage_ms
        },
    )
