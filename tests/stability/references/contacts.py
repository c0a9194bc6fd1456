"""How far a centre of gravity can sink between points: the highest plane below all gaps, there.

By definition rather than by simplex: of all planes through three points that no gap lies below, the
one that is highest at the centre; to 50 digits.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

from mpmath import mpf

from stability.references.writing import case, float64_case, refusal, write

# Four wheels, a P2AT's.
X, Y = [0.1442, 0.1442, -0.1442, -0.1442], [-0.2356, 0.2356, -0.2356, 0.2356]


def sink(x: list[Any], y: list[Any], gaps: list[Any]) -> Any:
    """Height of the plane at the centre."""
    # What is not below a plane may be above it by as little as the inputs are wrong.
    slack = mpf(10) ** -40 * (1 + max(abs(gap) for gap in gaps))
    heights = []
    for i, j, k in itertools.combinations(range(len(x)), 3):
        dx, dy, dg = x[j] - x[i], y[j] - y[i], gaps[j] - gaps[i]
        ex, ey, eg = x[k] - x[i], y[k] - y[i], gaps[k] - gaps[i]
        area = dx * ey - ex * dy
        if area == 0:
            continue
        b, c = (dg * ey - eg * dy) / area, (dx * eg - ex * dg) / area
        a = gaps[i] - b * x[i] - c * y[i]
        if all(g - a - b * u - c * v >= -slack for u, v, g in zip(x, y, gaps, strict=True)):
            heights.append(a)
    return max(heights)


def tolerance(gaps: list[float]) -> dict[str, Any]:
    """Tolerance by the largest gap, and what the search calls below a plane."""
    largest = max(map(abs, gaps))
    return {
        "float64": {
            "abs": 2e-9 + 2e-15 * largest,
            "reason": "a nanometre, which the search allows",
        },
        "float32": {"abs": 2e-9 + 1e-6 * largest, "reason": "rounded inputs"},
    }


def on_plane(slope_x: float, slope_y: float) -> list[float]:
    """Gaps of the four wheels above a plane."""
    return [slope_x * x + slope_y * y for x, y in zip(X, Y, strict=True)]


CASES = {
    "level": (X, Y, [0.02] * 4),
    "a plane of 30 degrees, where every triangle is a facet": (X, Y, on_plane(0.577, 0.1)),
    "one wheel on a stone": (X, Y, [0.0, 0.05, 0.05, 0.05]),
    "one wheel over an edge": (X, Y, [1000.0, 0.0, 0.0, 0.0]),
    "two wheels over an edge": (X, Y, [1000.0, 1000.0, 0.0, 0.0]),
    "a hair of a twist": (X, Y, [1e-12, 0.0, 0.0, 0.0]),
    "below the floor": (X, Y, [-0.003, -0.001, -0.002, -0.004]),
    "a base as narrow as a hair": ([1e-7, 1e-7, -1e-7, -1e-7], Y, [0.01, 0.02, 0.03, 0.05]),
    "a giant": ([1e5, 1e5, -1e5, -1e5], [-1e5, 1e5, -1e5, 1e5], [0.01, 0.02, 0.03, 0.05]),
    "many points of one plane": (
        [0.05 * i for i in range(-3, 4)] * 3,
        [-0.2] * 7 + [0.0] * 7 + [0.2] * 7,
        [0.1] * 21,
    ),
    "a point twice": ([*X, X[0]], [*Y, Y[0]], [0.01, 0.02, 0.0, 0.03, 0.01]),
    "a belly on an edge": ([*X, 0.01, 0.01], [*Y, -0.2, 0.2], [0.2, 0.2, 0.0, 0.0, 0.001, 0.001]),
}
# Three wheels whose centre is next to their border.
NEXT_TO_THE_BORDER = ([0.2, 0.2, -1e-9], [-0.2, 0.2, 0.0], [0.01, 0.02, 0.3])


def main() -> None:
    """Write the cases of the group."""
    rows = [
        case(name, {"x": x, "y": y, "gaps": gaps}, exact=sink, tolerance=tolerance(gaps))
        for name, (x, y, gaps) in CASES.items()
    ]
    x, y, gaps = NEXT_TO_THE_BORDER
    rows.append(
        float64_case(
            "a centre a nanometre within its wheels",
            {"x": x, "y": y, "gaps": gaps},
            exact=sink,
            tolerance=tolerance(gaps),
        )
    )
    outside = {"x": [0.3, 0.1, 0.3], "y": [-0.2, 0.0, 0.2], "gaps": [0.0, 0.0, 0.0]}
    lost = {"x": [math.nan, 0.1, 0.3], "y": [-0.2, 0.0, 0.2], "gaps": [0.0, 0.0, 0.0]}
    rows += [
        refusal("a centre beside all its wheels", outside, expect="invalid", which="falls"),
        refusal("a place that is not a number", lost, expect="invalid", which="falls"),
    ]
    write("contacts", "sink", rows)


if __name__ == "__main__":
    main()
