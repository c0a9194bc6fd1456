"""Hyperbolic mirror by geometry: a scene ray meets Eq. 1's sheet, a pinhole projects the point.

Independent of the forms that the product uses.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Any

from mpmath import atan, mpf, sqrt, tan

PAPER_K = 11.546
NEXT_TO_2 = math.nextafter(2.0, 3.0)
LARGEST = sys.float_info.max
RIM_T = math.tan(math.radians(60.0))
BEFORE_1, AFTER_1 = math.nextafter(1.0, 0.0), math.nextafter(1.0, 2.0)

# A dozen operations, none of which cancels.
TOLERANCE = {
    "float64": {"rel": 2e-15, "abs": 5e-324, "reason": "a dozen roundings, none amplified"},
    "float32": {"rel": 1e-6, "abs": 1.5e-45, "reason": "a dozen of 6e-8, none amplified"},
}


def limit_t(k: float) -> float:
    """t of the asymptote as a float, to choose cases; not a reference."""
    return math.sqrt(2.0) * math.sqrt(0.5 * (k - 1.0) + 0.5 * math.sqrt(k) * math.sqrt(k - 2.0))


def mirror_point(k: Any, c: Any, t: Any) -> tuple[Any, Any]:
    """(r, z) where a ray of t, aimed at the viewpoint, meets the sheet around it."""
    sine, cosine = 2 * t / (1 + t * t), (1 - t * t) / (1 + t * t)
    a, b, constant = cosine**2 - sine**2 * (k / 2 - 1), -c * cosine, c**2 / (2 * k)
    way = 2 * constant / (-b + sqrt(b * b - 4 * a * constant))
    return way * sine, way * cosine


def radius_ratio(k: Any, t: Any) -> Any:
    """r_i / h: the focal length f / h is sqrt(k (k - 2))."""
    r, z = mirror_point(k, mpf(1), t)
    return sqrt(k * (k - 2)) * r / (1 - z)


def t_of_ratio(k: Any, ratio: Any) -> Any:
    """t through the angles: psi = atan(r_i / f), tan(psi / 2) = kappa t."""
    s = sqrt(k * (k - 2))
    return tan(atan(ratio / s) / 2) * (k - 1 + s)


def amplified_tolerance(factor: float, reason: str) -> Mapping[str, Any]:
    """Tolerance where an ulp of an input moves the result by `factor` ulps."""
    return {
        "float64": {"rel": 2e-15 * factor, "reason": reason},
        "float32": {"rel": 1e-6 * factor, "reason": reason},
    }
