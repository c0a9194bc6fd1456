"""t = tan(theta / 2) of r_i / h: the inverse, from the axis to radii that no image has."""

from __future__ import annotations

import math
from typing import Any

from stability.references.mirror_exact import (
    BEFORE_1,
    LARGEST,
    NEXT_TO_2,
    PAPER_K,
    TOLERANCE,
    t_of_ratio,
)
from stability.references.writing import case, float64_case, refusal, write

PLACES = {
    "the centre": 0.0,
    "the smallest double beside the centre": 5e-324,
    "1e-300 beside the centre": 1e-300,
    "1e-8 beside the centre": 1e-8,
    "an ulp within the horizon circle": BEFORE_1,
    "the horizon circle": 1.0,
    "the rim circle": 1.7399260894,
    "a thousand times the horizon circle": 1e3,
    "1e300 times the horizon circle": 1e300,
}


def rows() -> list[dict[str, Any]]:
    """Cases."""
    papers = [_value(name, PAPER_K, ratio) for name, ratio in PLACES.items()]
    ks = {"an ulp above k 2": NEXT_TO_2, "k 2 + 1e-12": 2.0 + 1e-12, "k 2.1": 2.1}
    near_two = [
        float64_case(
            f"{name}, ratio {ratio:g}",
            {"k": k, "ratio": ratio},
            exact=t_of_ratio,
            tolerance=TOLERANCE,
        )
        for name, k in ks.items()
        for ratio in (1e-8, 1.0, 1e3)
    ]
    huge = [
        _value(f"k {k:.3g}, ratio {ratio:g}", k, ratio)
        for k in (1e9, 1e154, LARGEST)
        for ratio in (1.0, 1.7, 1e6)
    ]
    return [*papers, *near_two, *huge, *_refusals()]


def _value(name: str, k: float, ratio: float) -> dict[str, Any]:
    return case(name, {"k": k, "ratio": ratio}, exact=t_of_ratio, tolerance=TOLERANCE)


def _refusals() -> list[dict[str, Any]]:
    hard = {"below zero": -1e-9, "infinite": math.inf, "no number": math.nan}
    return [
        refusal(
            f"a ratio {name}", {"k": PAPER_K, "ratio": ratio}, expect="error", which="0 or more"
        )
        for name, ratio in hard.items()
    ]


if __name__ == "__main__":
    write("mirror", "incidence_from_radius", rows())
