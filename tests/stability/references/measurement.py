"""Measurement model: range and bearing of a landmark, their derivatives, and the innovation."""

from __future__ import annotations

import math
from typing import Any

from mpmath import atan2, sqrt

from stability.references.angles import wrap
from stability.references.motion import absolute, relative
from stability.references.writing import case, refusal, write


def polar(pose: Any, landmark: Any) -> tuple[Any, Any, Any, Any]:
    """Dx, dy, range and bearing."""
    dx, dy = landmark[0] - pose[0], landmark[1] - pose[1]
    return dx, dy, sqrt(dx**2 + dy**2), wrap(atan2(dy, dx) - pose[2])


def range_of(pose: Any, landmark: Any) -> Any:
    """Range."""
    return polar(pose, landmark)[2]


def bearing_of(pose: Any, landmark: Any) -> Any:
    """Bearing in (-pi, pi]."""
    return polar(pose, landmark)[3]


def jacobian(pose: Any, landmark: Any) -> list[Any]:
    """First two columns of H."""
    dx, dy, rho, _ = polar(pose, landmark)
    return [[-dx / rho, -dy / rho], [dy / rho**2, -dx / rho**2]]


def innovation(pose: Any, landmark: Any, measured: Any) -> list[Any]:
    """Innovation of a measurement (r, gamma)."""
    _, _, rho, bearing = polar(pose, landmark)
    return [measured[0] - rho, wrap(measured[1] - bearing)]


ORIGIN, FIELD = [0.0, 0.0, 0.0], [0.3, -1.7, 2.9]
PLACES = {
    "a beacon": (FIELD, [1.35, 1.9]),
    "straight ahead": (ORIGIN, [2.0, 0.0]),
    "straight behind": (ORIGIN, [-2.0, 0.0]),
    "straight behind from below the seam": (ORIGIN, [-2.0, -1e-300]),
    "just right of behind": (ORIGIN, [-2.0, 1e-12]),
    "just left of behind": (ORIGIN, [-2.0, -1e-12]),
    "behind a robot that looks back": ([0.0, 0.0, math.pi], [2.0, 0.0]),
    "at a range of 1e-12": (ORIGIN, [6e-13, 8e-13]),
    "at a range of 1e-300": (ORIGIN, [6e-301, 8e-301]),
    "at the smallest range with a reciprocal": (ORIGIN, [0.0, 2.3e-308]),
    "at a range of 1e200": (ORIGIN, [6e199, -8e199]),
    "at the ends of float64": ([-8e307, 0.0, 0.0], [8e307, 1e307]),
    "nearly the robot's own place, far out": ([1e3, 1e3, 1.0], [1e3 + 1e-3, 1e3]),
    "along an axis almost": (ORIGIN, [2.0, 1e-200]),
}
MEASURED = {
    "as expected": (ORIGIN, [2.0, 0.0], [2.0, 0.0]),
    "behind, across the seam": (ORIGIN, [-2.0, -1e-3], [2.0, math.pi - 1e-3]),
    "behind, across the seam backwards": (ORIGIN, [-2.0, 1e-3], [2.0, -math.pi + 1e-3]),
    "a turn too many": (ORIGIN, [0.0, 2.0], [2.1, 0.5 * math.pi + 2.0 * math.pi]),
    "heading across the seam": ([0.0, 0.0, 3.1], [-1.0, -0.2], [1.0, 0.2]),
    "opposite to the expected": (ORIGIN, [2.0, 0.0], [2.0, math.pi]),
    "a range of zero": (ORIGIN, [2.0, 1.0], [0.0, 0.4]),
    "a range of 1e200": (ORIGIN, [2.0, 1.0], [1e200, 0.4]),
}


def main() -> None:
    """Write the cases of the group."""
    files: dict[str, list[Any]] = {"range": [], "bearing": [], "jacobian": []}
    for name, (pose, landmark) in PLACES.items():
        inputs = {"pose": pose, "landmark": landmark}
        near = relative(2e-15, "a dozen roundings")
        files["range"].append(case(name, inputs, exact=range_of, tolerance=near))
        files["jacobian"].append(case(name, inputs, exact=jacobian, tolerance=near))
        turn = absolute(2.0, "an ulp of pi", turn=True)
        files["bearing"].append(case(name, inputs, exact=bearing_of, tolerance=turn))
    nowhere = {
        "at the robot": (FIELD, FIELD[:2]),
        "at the robot almost": (ORIGIN, [0.0, 5e-324]),
        "farther than float64 tells": ([-1.7e308, 0.0, 0.0], [1.7e308, 0.0]),
    }
    for name, (pose, landmark) in nowhere.items():
        inputs = {"pose": pose, "landmark": landmark}
        files["range"].append(refusal(name, inputs, expect="invalid", which="no expectation"))
    files["range"].append(
        refusal(
            "a landmark without a finite position",
            {"pose": ORIGIN, "landmark": [math.nan, 0.0]},
            expect="error",
            which="has no finite position",
        )
    )
    for formula, rows in files.items():
        write("measurement", formula, rows)
    rows = [
        case(
            name,
            {"pose": pose, "landmark": landmark, "measured": measured},
            exact=innovation,
            tolerance=absolute(max(4.0, measured[0]), "of pi and the range"),
        )
        for name, (pose, landmark, measured) in MEASURED.items()
    ]
    write("measurement", "innovation", rows)


if __name__ == "__main__":
    main()
