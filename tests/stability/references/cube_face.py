"""Cube face of a direction, and face coordinates: total and unique on every edge."""

from __future__ import annotations

import itertools
import math
from typing import Any

from mpmath import mpf

from stability.references.mirror_exact import LARGEST
from stability.references.writing import case, refusal, write

EXACT = {
    "float64": {"abs": 0.0, "reason": "a face is a face"},
    "float32": {"abs": 0.0, "reason": "a face is a face"},
}
QUOTIENT = {
    "float64": {"rel": 1.2e-16, "reason": "one division, correctly rounded"},
    "float32": {"rel": 1.2e-7, "reason": "one division, and the rounding of its result"},
}
CORNERS = [[x, y, z] for x, y, z in itertools.product((1.0, -1.0), repeat=3)]
EDGES = [
    [0.0 if axis == flat else value for axis, value in enumerate(corner)]
    for flat in range(3)
    for corner in CORNERS
    if corner[flat] > 0.0
]
AFTER = math.nextafter(1.0, 2.0)
HARD = {
    "an ulp from N towards E": [1.0, AFTER, 0.0],
    "an ulp from N towards C": [1.0, 0.0, AFTER],
    "an ulp from C towards W": [0.3, -AFTER, 1.0],
    "the zero vector goes to N": [0.0, 0.0, 0.0],
    "denormals, a tie": [5e-324, 5e-324, -5e-324],
    "the largest doubles, a tie": [-LARGEST, LARGEST, LARGEST],
    "minus zero": [-0.0, -0.0, -1.0],
}
COORDINATES = {
    "the middle of C": ([0.0, 0.0, 1.0], 4),
    "the edge from N to E": ([1.0, 1.0, 0.0], 0),
    "a corner, on its third face": ([1.0, 1.0, 1.0], 4),
    "the largest doubles": ([LARGEST, -LARGEST, 0.5 * LARGEST], 0),
    "denormals": ([1e-322, 1e-322, 5e-323], 0),
    "1e-300 beside the middle of W": ([0.0, -1.0, 1e-300], 3),
}
BEHIND = {
    "behind the face": ([-1.0, 0.0, 0.0], 0),
    "beside the face": ([0.0, 1.0, 0.0], 0),
    "next to beside the face": ([1e-300, 1.0, 0.0], 0),
    "no number": ([1.0, math.nan, 0.0], 0),
    "infinite": ([math.inf, math.inf, 0.0], 0),
}


def face_rows() -> list[dict[str, Any]]:
    """Cases of face_from_direction."""
    ties = {f"a tie at {_text(place)}": place for place in (*CORNERS, *EDGES)}
    values = [
        case(name, {"direction": at}, exact=face, tolerance=EXACT)
        for name, at in {**ties, **HARD}.items()
    ]
    refused = {"no number": [1.0, math.nan, 0.0], "infinite": [0.0, math.inf, 0.0]}
    return [
        *values,
        *(
            refusal(name, {"direction": at}, expect="error", which="finite")
            for name, at in refused.items()
        ),
    ]


def coordinate_rows() -> list[dict[str, Any]]:
    """Cases of face_coordinates."""
    values = [
        case(name, {"direction": at, "face": which}, exact=coordinates, tolerance=QUOTIENT)
        for name, (at, which) in COORDINATES.items()
    ]
    refused = [
        refusal(name, {"direction": at, "face": which}, expect="error", which="in front")
        for name, (at, which) in BEHIND.items()
    ]
    return [*values, *refused]


def face(direction: list[Any]) -> Any:
    """First of the faces with the largest forward component, in the order N, E, S, W, C, U."""
    x, y, z = direction
    ahead = [x, y, -x, -y, z, -z]
    return mpf(ahead.index(max(ahead)))


def coordinates(direction: list[Any], face: int) -> list[Any]:
    """[s, t]: right over forward, down over forward; only for faces that have cases."""
    x, y, z = direction
    ahead, right, down = {0: (x, y, z), 3: (-y, x, z), 4: (z, y, -x)}[face]
    return [right / ahead, down / ahead]


def _text(place: list[float]) -> str:
    return ", ".join(f"{value:g}" for value in place)


if __name__ == "__main__":
    write("cube", "face_from_direction", face_rows())
    write("cube", "face_coordinates", coordinate_rows())
