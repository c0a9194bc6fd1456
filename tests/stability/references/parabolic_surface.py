"""(r, z) of the parabolic mirror in metres, at the intersection with a ray of t."""

from __future__ import annotations

import math
from typing import Any

from stability.references.mirror_exact import AFTER_1, BEFORE_1, RIM_T, TOLERANCE
from stability.references.writing import case, refusal, write


def rows() -> list[dict[str, Any]]:
    """Cases."""
    places = {
        "the vertex": 0.0,
        "1e-300 beside the vertex": 1e-300,
        "an ulp below the horizon": BEFORE_1,
        "the horizon": 1.0,
        "an ulp above the horizon": AFTER_1,
        "the rim": RIM_T,
        "a thousand radii out": 1e3,
    }
    return [
        *(_value(name, 0.03, t) for name, t in places.items()),
        _value("1 mm, the rim", 1e-3, RIM_T),
        _value("1 km, the rim", 1e3, RIM_T),
        refusal("t infinite", _at(math.inf), expect="error", which="finite"),
        refusal("t no number", _at(math.nan), expect="error", which="finite"),
    ]


def point(horizon_m: Any, t: Any) -> list[Any]:
    """[r, z] on z = (p^2 - r^2) / 2p, in the direction of t."""
    r = horizon_m * t
    return [r, (horizon_m**2 - r**2) / (2 * horizon_m)]


def _value(name: str, horizon_m: float, t: float) -> dict[str, Any]:
    inputs = {"horizon_m": horizon_m, "t": t}
    return case(name, inputs, exact=point, tolerance=TOLERANCE)


def _at(t: float) -> dict[str, float]:
    return {"horizon_m": 0.03, "t": t}


if __name__ == "__main__":
    write("surface", "parabolic_surface", rows())
