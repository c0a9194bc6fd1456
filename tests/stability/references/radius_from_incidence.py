"""r_i / h of t = tan(theta / 2): axis, horizon, rim, asymptote, k from the plane to the largest."""

from __future__ import annotations

import math
from typing import Any

from stability.references.mirror_exact import (
    AFTER_1,
    BEFORE_1,
    LARGEST,
    NEXT_TO_2,
    PAPER_K,
    RIM_T,
    TOLERANCE,
    limit_t,
    radius_ratio,
)
from stability.references.writing import case, float64_case, refusal, write

WITH_THE_PAPERS_MIRROR = {
    "on the axis": 0.0,
    "the smallest double beside the axis": 5e-324,
    "1e-300 beside the axis": 1e-300,
    "1e-8 beside the axis": 1e-8,
    "half way to the horizon": 0.5,
    "an ulp below the horizon": BEFORE_1,
    "the horizon": 1.0,
    "an ulp above the horizon": AFTER_1,
    "the rim at 120 degrees": RIM_T,
    "an ulp before the asymptote": math.nextafter(limit_t(PAPER_K), 0.0),
    "beyond the asymptote, where the formula still holds": 10.0,
}
K_TWO = {"an ulp above k 2": NEXT_TO_2, "k 2 + 1e-12": 2.0 + 1e-12, "k 2.0001": 2.0001}
K_HUGE = {"k 1e3": 1e3, "k 1e9": 1e9, "k 1e15": 1e15, "k 1e154": 1e154, "the largest k": LARGEST}


def rows() -> list[dict[str, Any]]:
    """Cases."""
    papers = [_value(name, PAPER_K, t) for name, t in WITH_THE_PAPERS_MIRROR.items()]
    near_two = [
        float64_case(f"{name}, {place}", {"k": k, "t": t}, exact=radius_ratio, tolerance=TOLERANCE)
        for name, k in K_TWO.items()
        for place, t in _places(k).items()
    ]
    huge = [
        _value(f"{name}, {place}", k, t)
        for name, k in K_HUGE.items()
        for place, t in {"the horizon": 1.0, "the rim": RIM_T, "t 1e4": 1e4}.items()
        if t < limit_t(k)
    ]
    return [*papers, *near_two, *huge, *_refusals()]


def _value(name: str, k: float, t: float) -> dict[str, Any]:
    return case(name, {"k": k, "t": t}, exact=radius_ratio, tolerance=TOLERANCE)


def _places(k: float) -> dict[str, float]:
    return {
        "half way": 0.5,
        "the horizon": 1.0,
        "an ulp before the asymptote": math.nextafter(limit_t(k), 0.0),
    }


def _refusals() -> list[dict[str, Any]]:
    domain = "0 <= t"
    return [
        refusal("t 22, where the radius is negative", _at(22.0), expect="error", which=domain),
        refusal("t below zero", _at(-1e-9), expect="error", which=domain),
        refusal("t infinite", _at(math.inf), expect="error", which=domain),
        refusal("t no number", _at(math.nan), expect="error", which=domain),
        refusal("k 2, a plane", {"k": 2.0, "t": 0.5}, expect="error", which="k > 2"),
        refusal("k infinite", {"k": math.inf, "t": 0.5}, expect="error", which="k > 2"),
        refusal("k no number", {"k": math.nan, "t": 0.5}, expect="error", which="k > 2"),
    ]


def _at(t: float) -> dict[str, float]:
    return {"k": PAPER_K, "t": t}


if __name__ == "__main__":
    write("mirror", "radius_from_incidence", rows())
