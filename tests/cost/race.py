"""Frame times of several renderers in turns, so that a disturbance meets all of them alike.

A round renders one block of frames with each renderer. Every block begins with a frame that is not
timed: the others have just displaced its tables from the caches, which a renderer that works alone
never sees. Ratios are taken within a round; medians and quartiles are over rounds.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.objects import CameraState

# Renders one frame; what it returns is not read.
RenderCall = Callable[[CameraState], object]

TIMED_FRAMES = 2
MIN_ROUNDS, MAX_ROUNDS = 5, 60


@dataclass(frozen=True, slots=True)
class Quartiles:
    """Median and quartiles over rounds."""

    median: float
    lower: float
    upper: float

    @classmethod
    def of(cls, values: Floats) -> Quartiles:
        """Quartiles of (rounds,) values."""
        lower, median, upper = np.percentile(values, (25.0, 50.0, 75.0)).tolist()
        return cls(median, lower, upper)


@dataclass(frozen=True, slots=True, eq=False)
class RaceTimes:
    """Milliseconds a frame of each renderer in each round."""

    wall_ms: Mapping[str, Floats]
    """(rounds,) elapsed time by name."""
    processor_ms: Mapping[str, Floats]
    """(rounds,) processor time of all threads by name."""

    @property
    def rounds(self) -> int:
        """Number of rounds."""
        return len(next(iter(self.wall_ms.values())))

    def median_wall_ms(self) -> dict[str, float]:
        """Median elapsed time of a frame by name."""
        return {name: float(np.median(times)) for name, times in self.wall_ms.items()}

    def median_processor_ms(self) -> dict[str, float]:
        """Median processor time of a frame by name."""
        return {name: float(np.median(times)) for name, times in self.processor_ms.items()}

    def ratio(self, numerator: str, denominator: str) -> Quartiles:
        """Elapsed time of one renderer over another's, round by round."""
        return Quartiles.of(self.wall_ms[numerator] / self.wall_ms[denominator])

    def processor_ratio(self, numerator: str, denominator: str) -> Quartiles:
        """Processor time of one renderer over another's, round by round."""
        return Quartiles.of(self.processor_ms[numerator] / self.processor_ms[denominator])


def race(
    renderers: Mapping[str, RenderCall], states: Sequence[CameraState], *, seconds: float
) -> RaceTimes:
    """Time frames in turns for about `seconds`, in MIN_ROUNDS to MAX_ROUNDS rounds.

    Args:
        renderers: render calls by name.
        states: camera states, one a frame, in a cycle; all frames of a round have the same.
        seconds: time for all rounds; fewer than MIN_ROUNDS rounds are never timed.
    """
    _time_round(renderers, states[: TIMED_FRAMES + 1])
    rounds: list[dict[str, tuple[float, float]]] = []
    end = time.perf_counter() + seconds
    while len(rounds) < MIN_ROUNDS or (len(rounds) < MAX_ROUNDS and time.perf_counter() < end):
        first = len(rounds) * (TIMED_FRAMES + 1)
        block = [states[(first + offset) % len(states)] for offset in range(TIMED_FRAMES + 1)]
        rounds.append(_time_round(renderers, block))
    wall, processor = (
        {name: np.array([times[name][clock] for times in rounds]) for name in renderers}
        for clock in range(2)
    )
    return RaceTimes(wall, processor)


def _time_round(
    renderers: Mapping[str, RenderCall], states: Sequence[CameraState]
) -> dict[str, tuple[float, float]]:
    """Mean elapsed and processor milliseconds of the frames after the first, by name."""
    times = {}
    for name, render in renderers.items():
        render(states[0])
        begin = time.perf_counter(), time.process_time()
        for state in states[1:]:
            render(state)
        end = time.perf_counter(), time.process_time()
        scale = 1e3 / (len(states) - 1)
        times[name] = scale * (end[0] - begin[0]), scale * (end[1] - begin[1])
    return times
