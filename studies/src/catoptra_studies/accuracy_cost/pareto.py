"""The Pareto front: the steps that no other step beats in time and error at once."""

from __future__ import annotations

from collections.abc import Sequence

# Medians of times differ by so much from run to run: what gains less is not worth a step.
MIN_GAIN = 0.05


def pareto_front(
    points: Sequence[tuple[float, float]], *, min_gain: float = 0.0
) -> tuple[int, ...]:
    """Return the indices of the (time, error) points on the front, from fast to exact.

    A point is on it if no other is at least as good in both and better in one; of equal points the
    first is. A slower point must take at least a share `min_gain` off the error before it.
    """
    order = sorted(range(len(points)), key=lambda index: (*points[index], index))
    front: list[int] = []
    for index in order:
        if not front or points[index][1] < (1.0 - min_gain) * points[front[-1]][1]:
            front.append(index)
    return tuple(front)
