"""d(r_i / h) / d(theta): slope of the projection, through the angles of the capture camera."""

from __future__ import annotations

import math
from typing import Any

from mpmath import atan, cos, sqrt

from stability.references.mirror_exact import LARGEST, NEXT_TO_2, PAPER_K, RIM_T, TOLERANCE, limit_t
from stability.references.writing import case, float64_case, refusal, write


def rows() -> list[dict[str, Any]]:
    """Cases."""
    papers = {"the axis": 0.0, "1e-300": 1e-300, "the horizon": 1.0, "the rim": RIM_T}
    return [
        *(_value(f"the paper's mirror, {name}", PAPER_K, t) for name, t in papers.items()),
        _value("before the asymptote", PAPER_K, math.nextafter(limit_t(PAPER_K), 0.0)),
        *(
            float64_case(
                f"an ulp above k 2, t {t:g}",
                {"k": NEXT_TO_2, "t": t},
                exact=slope,
                tolerance=TOLERANCE,
            )
            for t in (0.5, 1.0)
        ),
        _value("k 1e9, the rim", 1e9, RIM_T),
        _value("the largest k, the rim", LARGEST, RIM_T),
        refusal("t no number", {"k": PAPER_K, "t": math.nan}, expect="error", which="0 <= t"),
        refusal("t 22, beyond all", {"k": PAPER_K, "t": 22.0}, expect="error", which="0 <= t"),
    ]


def slope(k: Any, t: Any) -> Any:
    """d(s tan psi) / d(theta) with tan(psi / 2) = kappa tan(theta / 2)."""
    s = sqrt(k * (k - 2))
    kappa = 1 / (k - 1 + s)
    psi = 2 * atan(kappa * t)
    return s / cos(psi) ** 2 * kappa * (1 + t * t) / (1 + (kappa * t) ** 2)


def _value(name: str, k: float, t: float) -> dict[str, Any]:
    return case(name, {"k": k, "t": t}, exact=slope, tolerance=TOLERANCE)


if __name__ == "__main__":
    write("mirror", "magnification", rows())
