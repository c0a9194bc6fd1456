"""The Pareto front of time and error: points that no other point beats in both."""

from __future__ import annotations

from collections.abc import Sequence

# Medians of times differ by as much from run to run, so a smaller gain in error is no reason to
# pay for a slower level.
MIN_GAIN = 0.05


def pareto_front(
    points: Sequence[tuple[float, float]], *, min_gain: float = 0.0
) -> tuple[int, ...]:
    """Indices of the (time, error) points on the front, from fast to exact.

    A point is on the front if no other is at least as good in both and better in one; of equal
    points the first counts.

    Args:
        points: (time, error) of each candidate.
        min_gain: Fraction of the preceding error that a slower point must remove.
    """
    # Sorted by time, a point is on the front exactly if its error is below that of the last one.
    order = sorted(range(len(points)), key=lambda index: (*points[index], index))
    front: list[int] = []
    for index in order:
        if not front or points[index][1] < (1.0 - min_gain) * points[front[-1]][1]:
            front.append(index)
    return tuple(front)
