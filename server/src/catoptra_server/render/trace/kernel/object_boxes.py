"""Boxes around the parts of a dynamic object.

The kernel traces a dynamic object only where a box of it reaches into a part of the image. One box
around a robot with a camera tower is mostly empty: a few boxes around its parts are met by half as
many rays.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.objects import ObjectMesh

# Every box costs a frame up to six candidates.
_MAX_BOXES = 8
# A division that saves less of the boxes' surface does not pay for the sides that it adds.
_LEAST_SAVING = 0.05

_Order = npt.NDArray[np.intp]


def enclose_parts(mesh: ObjectMesh) -> Floats:
    """(b, 6) centres and half sizes of boxes that together hold a mesh, in its frame, metres."""
    low, high = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    parts = [np.arange(len(mesh))]
    while len(parts) < _MAX_BOXES:
        areas = [_area(low[part].min(axis=0), high[part].max(axis=0)) for part in parts]
        divisions = [_divide(low[part], high[part]) for part in parts]
        savings = [area - after for area, (after, _) in zip(areas, divisions, strict=True)]
        best = int(np.argmax(savings))
        if savings[best] <= _LEAST_SAVING * sum(areas):
            break
        part, (_, (first, second)) = parts[best], divisions[best]
        parts[best : best + 1] = [part[first], part[second]]
    bounds = [(low[part].min(axis=0), high[part].max(axis=0)) for part in parts]
    return np.array([(*(0.5 * (a + b)), *(0.5 * (b - a))) for a, b in bounds])


def _divide(low: Floats, high: Floats) -> tuple[float, tuple[_Order, _Order]]:
    """Division of (n, 3) boxes of triangles in two with the least surface, and that surface."""
    best: tuple[float, tuple[_Order, _Order]] = (math.inf, (np.arange(0), np.arange(0)))
    for axis in range(3):
        order = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        first = _running_area(low[order], high[order])[:-1]
        second = _running_area(low[order[::-1]], high[order[::-1]])[::-1][1:]
        if len(first) and (first + second).min() < best[0]:
            split = int((first + second).argmin()) + 1
            best = float((first + second).min()), (order[:split], order[split:])
    return best


def _running_area(low: Floats, high: Floats) -> Floats:
    """Surface of the box around the first 1, 2, ... n boxes."""
    return _area(np.minimum.accumulate(low), np.maximum.accumulate(high))


def _area(low: Floats, high: Floats) -> Floats:
    """Surface of boxes between (..., 3) corners."""
    x, y, z = np.moveaxis(high - low, -1, 0)
    area: Floats = 2.0 * (x * y + y * z + z * x)
    return area
