"""(r, z) of the hyperbolic mirror in metres: scales of c, vertex, 90-degree circle, far out."""

from __future__ import annotations

import math
from typing import Any

from stability.references.mirror_exact import (
    AFTER_1,
    BEFORE_1,
    NEXT_TO_2,
    PAPER_K,
    RIM_T,
    TOLERANCE,
    amplified_tolerance,
    limit_t,
    mirror_point,
)
from stability.references.writing import case, float64_case, refusal, write

C_PAPER = 0.2321
FAR = "one over the distance to the asymptote: an ulp of t moves the place by as many ulps"


def rows() -> list[dict[str, Any]]:
    """Cases."""
    scales = {"a micrometre": 1e-6, "1 mm": 1e-3, "the paper's": C_PAPER, "1 km": 1e3, "1e9 m": 1e9}
    return [
        *(
            _value(f"{name}, {place}", c, t)
            for name, c in scales.items()
            for place, t in {"the vertex": 0.0, "the horizon": 1.0, "the rim": RIM_T}.items()
        ),
        _value("1e-300 beside the vertex", C_PAPER, 1e-300),
        _value("an ulp below the horizon", C_PAPER, BEFORE_1),
        _value("an ulp above the horizon", C_PAPER, AFTER_1),
        *_flat_and_parabolic(),
        case(
            "a thousandth before the asymptote",
            {"k": PAPER_K, "c_m": C_PAPER, "t": limit_t(PAPER_K) * (1.0 - 1e-3)},
            exact=point,
            tolerance=amplified_tolerance(2e3, FAR),
        ),
        float64_case(
            "a billionth before the asymptote",
            {"k": PAPER_K, "c_m": C_PAPER, "t": limit_t(PAPER_K) * (1.0 - 1e-9)},
            exact=point,
            tolerance=amplified_tolerance(2e9, FAR),
        ),
        *_refusals(),
    ]


def _flat_and_parabolic() -> list[dict[str, Any]]:
    places = {"the vertex": 0.0, "half way": 0.5, "the horizon": 1.0}
    flat = [
        float64_case(
            f"an ulp above k 2, {place}",
            {"k": NEXT_TO_2, "c_m": C_PAPER, "t": t},
            exact=point,
            tolerance=TOLERANCE,
        )
        for place, t in places.items()
    ]
    return [*flat, *(_value(f"k 1e9, {place}", C_PAPER, t, k=1e9) for place, t in places.items())]


def _value(name: str, c: float, t: float, *, k: float = PAPER_K) -> dict[str, Any]:
    return case(name, {"k": k, "c_m": c, "t": t}, exact=point, tolerance=TOLERANCE)


def _refusals() -> list[dict[str, Any]]:
    at = {"k": PAPER_K, "c_m": C_PAPER}
    limit = math.nextafter(limit_t(PAPER_K), 9.0)
    return [
        refusal("beyond the asymptote", {**at, "t": limit}, expect="error", which="asymptote"),
        refusal("t no number", {**at, "t": math.nan}, expect="error", which="asymptote"),
        refusal("t below zero", {**at, "t": -0.1}, expect="error", which="asymptote"),
        refusal("c 0", {"k": PAPER_K, "c_m": 0.0, "t": 1.0}, expect="error", which="c > 0"),
        refusal("c below 0", {"k": PAPER_K, "c_m": -1.0, "t": 1.0}, expect="error", which="c < 0"),
    ]


def point(k: Any, c_m: Any, t: Any) -> list[Any]:
    """[r, z]."""
    return list(mirror_point(k, c_m, t))


if __name__ == "__main__":
    write("surface", "hyperbolic_surface", rows())
