"""Triangles in pieces that lie together, each with a box: of most scenes most is never looked at.

Raster sends a face no chunk that it cannot see: without it five faces send five times the scene,
and a frame of 60 000 or a million triangles takes a fifth longer on llvmpipe
(tests/measurements/raster_faces.py). Summaries ask no chunk that is not near.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats

Indices = npt.NDArray[np.intp]

# From 32 to 1024 a frame differs by 5 % (tests/measurements/raster_faces.py); a million triangles
# are then ten thousand boxes, a millisecond's work.
TRIANGLES_PER_CLUSTER = 96


@dataclass(frozen=True, slots=True, eq=False)
class TriangleClusters:
    """An order of triangles, group by group, cut into chunks.

    order: (n,) triangle at each place. borders: (m + 1,) places where chunks begin and end.
    low, high: (m, 3) corners of each chunk's box. group: (m,) the group of each chunk.
    """

    order: Indices
    offsets: Indices
    box_min: Floats
    box_max: Floats
    groups: Indices

    def distances(self, point: Floats) -> Floats:
        """Return the (m,) distance from a (3,) point to each box, 0 inside."""
        outside = np.maximum(np.maximum(self.box_min - point, point - self.box_max), 0.0)
        distance: Floats = np.sqrt(np.square(outside).sum(axis=-1))
        return distance

    def in_front_of_planes(self, normals: Floats, point: Floats) -> Bools:
        """Return (..., m) which boxes reach in front of all (..., p, 3) planes through a point."""
        half = 0.5 * (self.box_max - self.box_min)
        middle = 0.5 * (self.box_max + self.box_min) - point
        flat = normals.reshape(-1, 3)
        reach = flat @ middle.T + np.abs(flat) @ half.T
        in_front = (reach >= 0.0).reshape(*normals.shape[:-1], len(half))
        return np.asarray(in_front.all(axis=-2))


def make_clusters(
    corners: Floats, groups: Indices, *, size: int = TRIANGLES_PER_CLUSTER
) -> TriangleClusters:
    """Return the chunks of (n, 3, 3) triangles of (n,) groups: neighbours in space together."""
    order = np.lexsort((_morton_codes(corners.mean(axis=1)), groups))
    counts = np.bincount(groups[order]) if len(order) else np.zeros(0, dtype=np.intp)
    ends = np.cumsum(counts)
    starts = [np.arange(end - count, end, size) for count, end in zip(counts, ends, strict=True)]
    first = np.concatenate([np.zeros(0, dtype=np.intp), *starts]).astype(np.intp)
    ordered = corners[order].reshape(-1, 9)
    empty = not len(first)
    low = np.zeros((0, 9)) if empty else np.minimum.reduceat(ordered, first, axis=0)
    high = np.zeros((0, 9)) if empty else np.maximum.reduceat(ordered, first, axis=0)
    return TriangleClusters(
        order=order,
        offsets=np.append(first, len(order)),
        box_min=low.reshape(-1, 3, 3).min(axis=1),
        box_max=high.reshape(-1, 3, 3).max(axis=1),
        groups=groups[order][first],
    )


def visible_runs(visible: Bools, offsets: Indices) -> list[tuple[int, int]]:
    """Return (first, count) places of the triangles in unbroken runs of visible chunks."""
    padded = np.concatenate(([False], visible, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    places = offsets[edges].reshape(-1, 2)
    return [(int(start), int(stop - start)) for start, stop in places]


def _morton_codes(points: Floats) -> npt.NDArray[np.uint64]:
    """Return (n,) codes that sort (n, 3) points along a space-filling curve, 21 bits an axis."""
    if not len(points):
        return np.zeros(0, dtype=np.uint64)
    low, high = points.min(axis=0), points.max(axis=0)
    extent = max(float((high - low).max()), 1e-12)
    cells = ((points - low) / extent * (2**21 - 1)).astype(np.uint64)
    x, y, z = _spread_bits(cells).T
    codes: npt.NDArray[np.uint64] = x | y << np.uint64(1) | z << np.uint64(2)
    return codes


# Each step halves the groups of bits and moves them apart, until two zeros follow every bit.
_SPREAD_STEPS = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def _spread_bits(values: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    for shift, mask in _SPREAD_STEPS:
        values = (values | values << np.uint64(shift)) & np.uint64(mask)
    return values
