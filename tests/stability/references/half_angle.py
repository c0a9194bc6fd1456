"""t = tan(theta / 2) of a direction: axis, horizon, antipode, denormals, the largest doubles."""

from __future__ import annotations

import math
from typing import Any

from mpmath import sqrt

from stability.references.mirror_exact import LARGEST
from stability.references.writing import case, refusal, write

TOLERANCE = {
    "float64": {"rel": 1.2e-15, "reason": "five roundings, none amplified"},
    "float32": {"rel": 6e-7, "reason": "five roundings of 6e-8, none amplified"},
}
DENORMAL = {
    "float64": {"abs": 5e-324, "reason": "the spacing of the smallest doubles"},
    "float32": {"abs": 1.5e-45, "reason": "the spacing of the smallest floats"},
}

VALUES = {
    "the axis": [0.0, 0.0, 1.0],
    "1e-300 beside the axis": [1e-300, 0.0, 1.0],
    "1e-8 beside the axis": [1e-8, 0.0, 1.0],
    "the horizon": [0.6, -0.8, 0.0],
    "the horizon, z minus 0": [0.6, -0.8, -0.0],
    "1e-17 below the horizon": [1.0, 0.0, 1e-17],
    "1e-17 above the horizon": [1.0, 0.0, -1e-17],
    "1e-8 beside the antipode": [1e-8, 0.0, -1.0],
    "1e-300 beside the antipode": [0.0, 1e-300, -1.0],
    "a vector of 1e-300": [3e-301, -2e-301, 1e-300],
    "a vector of denormals": [5e-324, 5e-324, 0.0],
    "a vector of denormals below the horizon": [1e-320, 2e-320, 3e-320],
    "a vector of 1e308": [1e308, 1e308, 1e308],
    "a vector of the largest doubles": [LARGEST, -LARGEST, -LARGEST],
}
NO_VALUE = {
    "the zero vector": [0.0, 0.0, 0.0],
    "the antipode": [0.0, 0.0, -1.0],
    "a denormal beside the antipode": [5e-324, 0.0, -1.0],
    "x infinite": [math.inf, 0.0, 1.0],
    "z minus infinite": [0.0, 0.0, -math.inf],
    "y no number": [1.0, math.nan, 0.0],
}


def rows() -> list[dict[str, Any]]:
    """Cases."""
    values = [
        case(name, {"direction": direction}, exact=tangent, tolerance=TOLERANCE)
        for name, direction in VALUES.items()
    ]
    beside = case(
        "a denormal beside the axis",
        {"direction": [1e-322, 0.0, 1.0]},
        exact=tangent,
        tolerance=DENORMAL,
    )
    refused = [
        refusal(name, {"direction": direction}, expect="invalid", which="")
        for name, direction in NO_VALUE.items()
    ]
    return [*values, beside, *refused]


def tangent(direction: list[Any]) -> Any:
    """Rho / (n + z), or where that is 0 / 0 in 700 digits, (n - z) / rho."""
    x, y, z = direction
    rho, norm = sqrt(x * x + y * y), sqrt(x * x + y * y + z * z)
    return rho / (norm + z) if z >= 0 else (norm - z) / rho


if __name__ == "__main__":
    write("pixel", "half_angle", rows())
