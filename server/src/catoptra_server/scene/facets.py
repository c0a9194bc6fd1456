"""Geometry of many triangles: normals by their winding, areas, and the box around all.

Components of a coordinate are kept in arrays of their own within a block: NumPy's operations on
(n, 3) arrays take several times as long.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene.row_blocks import row_blocks

# Coordinates in a row of a reduction: NumPy reduces long rows with vector instructions, rows of
# three one by one (10 in place of 240 ms for a million triangles). A multiple of three.
_REDUCTION_ROW = 576


def facet_normals(corners: Floats) -> tuple[Floats, Bools]:
    """Unit normals of (n, 3, 3) triangles by their winding, and whether each has an area.

    Returns:
        (n, 3) normals, 0 for a triangle without area, and (n,) triangles with an area, however
            small.
    """
    normals = np.zeros((len(corners), 3))
    has_area = np.zeros(len(corners), dtype=bool)
    for block in row_blocks(len(corners)):
        normals[block].T[:], has_area[block] = _unit_normals(corners[block])
    return normals, has_area


def _unit_normals(corners: Floats) -> tuple[Floats, Bools]:
    """(3, m) unit normals of (m, 3, 3) triangles, and the (m,) triangles with an area."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    b, c = b - a, c - a  # edges from the first corner
    # Relative to the longest edge: the product of two tiny edges would underflow.
    size = np.maximum(np.abs(b).max(axis=0), np.abs(c).max(axis=0))
    size[size == 0.0] = 1.0
    (bx, by, bz), (cx, cy, cz) = b / size, c / size
    cross = np.stack((by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx))
    length = np.sqrt(np.square(cross).sum(axis=0))
    has_area = length > 0.0
    return cross / np.where(has_area, length, 1.0), has_area


def hit_normals(normals: Floats, triangles: npt.NDArray[np.int32]) -> Floats:
    """(m, 3) normals of hit triangles, from the (n, 3) of all; zero for -1, which is no hit."""
    hits = np.zeros((len(triangles), 3))
    is_hit = triangles >= 0
    hits[is_hit] = normals[triangles[is_hit]]
    return hits


def bounding_box(corners: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest (3,) coordinates of (n, 3, 3) triangles; inf and -inf without any."""
    flat = corners.reshape(-1)
    num_whole = len(flat) - len(flat) % _REDUCTION_ROW
    rows, rest = flat[:num_whole].reshape(-1, _REDUCTION_ROW), flat[num_whole:].reshape(-1, 3)
    low = rows.min(axis=0, initial=np.inf).reshape(-1, 3).min(axis=0)
    high = rows.max(axis=0, initial=-np.inf).reshape(-1, 3).max(axis=0)
    return (
        np.minimum(low, rest.min(axis=0, initial=np.inf)),
        np.maximum(high, rest.max(axis=0, initial=-np.inf)),
    )
