"""Long arrays of triangles: blocks of rows, equal rows, clusters, boxes, exact distances.

Rows: an expression over a million triangles writes and reads every intermediate result in memory.
In blocks the intermediate results stay in the processor's cache: normals of a million triangles
take 42 ms in place of 300, bounds of their radiance a quarter of the time.

Clusters: neighbouring triangles with a box around them, for culling. Raster sends a face no cluster
outside the face's view: without culling, five faces send five times the scene, and a frame of
60 thousand or a million triangles takes a fifth longer on llvmpipe
(tests/measurements/raster_faces.py).

Boxes: all bounds of a static scene (`effects/bounds`) and the obstacles of robots descend one
hierarchy of boxes, so that their time follows from what is near, not from the number of triangles
of a scene.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import hypot, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass

Indices = npt.NDArray[np.intp]

# 4096 to 65 536 rows take about as long: 600 KiB of corners at 8192, the size of a level 2 cache.
ROWS_PER_BLOCK = 8192


def row_blocks(num_rows: int) -> Iterator[slice]:
    """Yield slices that cover all rows, in order."""
    for first in range(0, num_rows, ROWS_PER_BLOCK):
        yield slice(first, min(first + ROWS_PER_BLOCK, num_rows))


def tile_over_block(point: Floats) -> Floats:
    """A (3,) point for each corner of a block of triangles, flat.

    NumPy's operations on rows of three take twice as long as on flat arrays.
    """
    return np.tile(point, 3 * ROWS_PER_BLOCK)


def gather_rows(values: Floats, indices: npt.NDArray[np.integer]) -> Floats:
    """(n, k, ...) rows of (v, ...) values by (n, k) indices.

    In blocks: NumPy widens all indices to eight bytes, which take new memory for a moment.
    """
    gathered = np.zeros((*indices.shape, *values.shape[1:]))
    for block in row_blocks(len(indices)):
        gathered[block] = values.take(indices[block], axis=0)
    return gathered


def select_rows(values: Floats, mask: Bools) -> Floats:
    """Rows of a (n,) mask; the array itself where the mask has all."""
    return values if mask.all() else values[mask]


# Odd numbers with bits all over, powers of 2^64 over the golden ratio: one for each number of a row
# of `first_occurrences`. Without `numpy.random`, which takes 15 ms to load.
_HASH_FACTORS = np.uint64(0x9E3779B97F4A7C15) ** np.arange(1, 17, dtype=np.uint64)


def first_occurrences(values: Floats) -> Indices:
    """Rows of (n, ...) finite numbers, at most 16 a row, that equal no earlier one.

    Rows are compared by a hash of 64 bits, and in full where two hashes agree. Two equal rows with
    a different row of the same hash between them would both count.
    """
    hashes = _hash_rows(values)
    order = np.argsort(hashes, kind="stable")
    same_hash = np.flatnonzero(hashes[order][1:] == hashes[order][:-1])
    earlier, later = order[same_hash], order[same_hash + 1]
    is_equal = (values[earlier] == values[later]).all(axis=tuple(range(1, values.ndim)))
    is_first = np.ones(len(values), dtype=bool)
    is_first[later[is_equal]] = False
    return np.flatnonzero(is_first)


def _hash_rows(values: Floats) -> npt.NDArray[np.uint64]:
    """(n,) hashes of (n, ...) numbers; equal rows have equal hashes."""
    columns = np.moveaxis(values, 0, -1).reshape(math.prod(values.shape[1:]), len(values))
    hashes = np.zeros(len(values), dtype=np.uint64)
    # -0.0 + 0.0 is 0.0: equal numbers have equal bits.
    for column, factor in zip((columns + 0.0).view(np.uint64), _HASH_FACTORS, strict=False):
        # Low bits of round numbers are zeros, which a product alone would keep.
        hashes = (hashes ^ column ^ (column >> np.uint64(31))) * factor
    return hashes


# Between 32 and 1024 the time of a frame differs by 5 % (tests/measurements/raster_faces.py); a
# million triangles are then ten thousand boxes, a millisecond to cull.
TRIANGLES_PER_CLUSTER = 96


@dataclass(frozen=True, slots=True, eq=False)
class TriangleClusters:
    """Order of triangles, group by group, cut into m clusters."""

    order: Indices
    """(n,) index of the triangle at each position."""
    offsets: Indices
    """(m + 1,) positions at which clusters begin, and the end."""
    box_min: Floats
    """(m, 3)."""
    box_max: Floats
    """(m, 3)."""
    groups: Indices
    """(m,) group of each cluster."""

    @property
    def centres(self) -> Floats:
        """(m, 3) centres of the boxes."""
        return np.asarray(0.5 * (self.box_min + self.box_max))

    @property
    def half_sizes(self) -> Floats:
        """(m, 3) half sizes of the boxes."""
        return np.asarray(0.5 * (self.box_max - self.box_min))

    def distances(self, point: Floats) -> Floats:
        """(m,) distances from a (3,) point to each box, 0 inside."""
        outside = np.maximum(np.maximum(self.box_min - point, point - self.box_max), 0.0)
        distance: Floats = np.sqrt(np.square(outside).sum(axis=-1))
        return distance

    def in_front_of_planes(self, normals: Floats, point: Floats) -> Bools:
        """(..., m) boxes that reach in front of all of (..., p, 3) planes through a point."""
        half, centre = self.half_sizes, self.centres - point
        flat = normals.reshape(-1, 3)
        # Support of a box: its centre's product plus its half axes' absolute products.
        reach = matmul(flat, centre.T) + matmul(np.abs(flat), half.T)
        in_front = (reach >= 0.0).reshape(*normals.shape[:-1], len(half))
        return np.asarray(in_front.all(axis=-2))


def make_clusters(
    corners: Floats, groups: Indices, *, size: int = TRIANGLES_PER_CLUSTER
) -> TriangleClusters:
    """Cluster triangles so that neighbours in space share a box.

    Args:
        corners: (n, 3, 3).
        groups: (n,) group of each triangle; no cluster has two.
        size: Largest number of triangles in a cluster.
    """
    # Neighbours on a Morton curve are neighbours in space: one sort in place of a built tree.
    order = np.lexsort((_morton_codes(_vertex_sums(corners)), groups))
    counts = np.bincount(groups[order]) if len(order) else np.zeros(0, dtype=np.intp)
    ends = np.cumsum(counts)
    starts = [np.arange(end - count, end, size) for count, end in zip(counts, ends, strict=True)]
    first = np.concatenate([np.zeros(0, dtype=np.intp), *starts]).astype(np.intp)
    # Rows of nine, whole: three times as fast as rows of arrays.
    ordered = corners.reshape(-1, 9).take(order, axis=0)
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


def triangle_boxes(corners: Floats) -> tuple[Floats, Floats]:
    """(3, n) smallest and largest coordinates of (n, 3, 3) triangles."""
    # Coordinates first: reductions over three numbers take ten times as long.
    by_corner = np.ascontiguousarray(corners.transpose(1, 2, 0))
    return by_corner.min(axis=0), by_corner.max(axis=0)


def visible_runs(visible: Bools, offsets: Indices) -> list[tuple[int, int]]:
    """(first, count) positions of the triangles in unbroken runs of visible clusters."""
    padded = np.concatenate(([False], visible, [False]))
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    spans = offsets[edges].reshape(-1, 2)
    return [(int(start), int(stop - start)) for start, stop in spans]


def _vertex_sums(corners: Floats) -> Floats:
    """(3, n) sums of each triangle's corners: three times the centres, whose order is the same."""
    first, second, third = corners.transpose(1, 2, 0)
    sums = np.zeros(first.shape)
    np.add(np.add(first, second, out=sums), third, out=sums)
    return sums


def _morton_codes(points: Floats) -> npt.NDArray[np.uint64]:
    """(n,) codes that sort (3, n) points along a space-filling curve, 21 bits an axis."""
    codes = np.zeros(points.shape[1], dtype=np.uint64)
    low = points.min(axis=1, initial=np.inf)[:, None]
    high = points.max(axis=1, initial=-np.inf)[:, None]
    extent = max(float((high - low).max()), 1e-12)
    for block in row_blocks(len(codes)):
        cells = ((points[:, block] - low) / extent * (2**21 - 1)).astype(np.uint64)
        x, y, z = _spread_bits(cells)
        codes[block] = x | y << np.uint64(1) | z << np.uint64(2)
    return codes


# Each step halves the groups of bits and moves the halves apart, until two zeros follow every bit.
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


# Triangles a group, a power of two as in a block of rows; boxes a larger one, and roots. Small
# groups have tight boxes: a new cell among a million triangles measures two batches of groups of
# 32, and one of these.
GROUP_SIZE, _BRANCHING, _MAX_ROOTS = 8, 16, 128
# Diagonal of a group's box over the diagonal of a square of its share of a surface.
_MAX_BOX_RATIO = 8.0


class TriangleHierarchy:
    """Triangles in groups of neighbours, with a hierarchy of boxes around the groups.

    A million triangles take 0.1 s.
    """

    corners: Floats
    """(n, 3, 3) corners, row by row."""
    sizes: Floats
    """(n,) longest edge of the triangle at each row."""
    levels: list[Floats]
    """(7, m) boxes of each level, as by `_group_triangles`: groups first, roots last."""
    order: Indices | None = None
    """(n,) index of the triangle at each row; None for the given order."""

    def __init__(self, corners: Floats) -> None:
        """Group (n, 3, 3) corners."""
        self.corners = corners
        self.sizes, boxes = _group_triangles(corners)
        # Neighbours in a file are most often neighbours in space, and to sort a million triangles
        # takes 0.4 s: only an order without any sense is mended.
        if _are_large(boxes):
            self.order = make_clusters(corners, np.zeros(len(corners), dtype=np.intp)).order
            self.corners = corners[self.order]
            self.sizes, boxes = _group_triangles(self.corners)
        # Groups that are neighbours in space share larger boxes.
        self._numbers = np.argsort(_morton_codes(boxes[:3] - boxes[3:6]), kind="stable")
        self.levels = [boxes.take(self._numbers, axis=1)]
        while (count := self.levels[-1].shape[1]) > _MAX_ROOTS:
            first = np.arange(0, count, _BRANCHING)
            self.levels.append(np.minimum.reduceat(self.levels[-1], first, axis=1))

    def children(self, level: int, boxes: Indices) -> tuple[Indices, Indices]:
        """Positions among (k,) boxes of a level, and their parts in the level below."""
        parts = boxes[:, None] * _BRANCHING + np.arange(_BRANCHING)
        parent, part = np.nonzero(parts < self.levels[level - 1].shape[1])
        return parent, parts[parent, part]

    def find_near(self, low: Floats, high: Floats) -> Indices:
        """Triangles in groups whose boxes meet a box of (3,) corners, ascending."""
        boxes = np.arange(self.levels[-1].shape[1])
        for level in reversed(range(len(self.levels))):
            near = self.levels[level].take(boxes, axis=1)
            meets = (near[:3] <= high[:, None]) & (-near[3:6] >= low[:, None])
            boxes = boxes[meets.all(axis=0)]
            if level:
                _, boxes = self.children(level, boxes)
        rows = self.rows(boxes).ravel()
        triangles = np.sort(rows if self.order is None else self.order[rows])
        # Not `unique`, which loads `numpy.ma`: the last group may have a row several times.
        return triangles[np.diff(triangles, prepend=-1) > 0]

    def rows(self, groups: Indices) -> Indices:
        """(k, GROUP_SIZE) rows of groups; a shorter one has its last row several times."""
        rows: Indices = self._numbers[groups, None] * GROUP_SIZE + np.arange(GROUP_SIZE)
        return np.minimum(rows, len(self.corners) - 1)


def _group_triangles(corners: Floats) -> tuple[Floats, Floats]:
    """Longest edges of (n, 3, 3) triangles, and boxes around groups of rows.

    Returns:
        (n,) lengths; and (7, m) for each box its least coordinates, its greatest and its longest
        edge, these two negative, so that a larger box has the minima of its parts.
    """
    sizes, boxes = np.zeros(len(corners)), [np.zeros((7, 0))]
    for block in row_blocks(len(corners)):
        a, b, c = by_corner = np.ascontiguousarray(corners[block].transpose(1, 2, 0))
        squares = [np.square(edge).sum(axis=0) for edge in (b - a, c - b, a - c)]
        np.sqrt(np.maximum(np.maximum(*squares[:2]), squares[2]), out=sizes[block])
        # The last group is filled up with the last row.
        count = len(sizes[block])
        whole = np.zeros((7, -(-count // GROUP_SIZE) * GROUP_SIZE))
        by_corner.min(axis=0, out=whole[:3, :count])
        np.negative(by_corner.max(axis=0), out=whole[3:6, :count])
        np.negative(sizes[block], out=whole[6, :count])
        whole[:, count:] = whole[:, count - 1 : count]
        # By halves: a seventh of the time of `reduceat`.
        for _ in range(GROUP_SIZE.bit_length() - 1):
            whole = np.minimum(whole[:, ::2], whole[:, 1::2])
        boxes.append(whole)
    return sizes, np.concatenate(boxes, axis=1)


def _are_large(boxes: Floats) -> bool:
    """Whether (7, m) boxes are far larger than those of a divided surface would be."""
    if not boxes.shape[1]:
        return False
    whole_m = float(hypot(*(boxes[:3].min(axis=1) + boxes[3:6].min(axis=1))))
    mean_m = float(np.linalg.norm(boxes[:3] + boxes[3:6], axis=0).mean())
    return mean_m > _MAX_BOX_RATIO * whole_m / math.sqrt(boxes.shape[1])


# A triangle that is a line but for rounding has a normal without any sense.
_MIN_SQUARED_SINE = 1e-26


def triangle_distances(point: Floats, corners: Floats) -> Floats:
    """(n,) distances from a (3,) point to (n, 3, 3) triangles; those without area count as lines.

    Ericson 2005, Real-Time Collision Detection, 5.1.5: the plane's distance where the point's
    projection lies within the triangle, else the nearest edge's.
    """
    # Coordinates first, triangles last: NumPy's loops over three numbers are slow. Two corners
    # follow again: neighbours are then slices.
    around = (corners - point).transpose(2, 1, 0).take((0, 1, 2, 0, 1), axis=1)
    edges = around[:, 1:] - around[:, :4]
    corner, edge, following = around[:, :3], edges[:, :3], edges[:, 1:]
    square, offset = _dot(edge, edge), _dot(corner, edge)
    along = np.minimum(np.maximum(-offset / np.where(square > 0.0, square, 1.0), 0.0), 1.0)
    nearest = corner + along * edge
    to_edges = _dot(nearest, nearest).min(axis=0)
    a, b = edges[:, 0], edges[:, 1]
    normal = a.take((1, 2, 0), axis=0) * b.take((2, 0, 1), axis=0)
    normal -= a.take((2, 0, 1), axis=0) * b.take((1, 2, 0), axis=0)
    area = _dot(normal, normal)
    has_area = area > _MIN_SQUARED_SINE * square[0] * square[1]
    to_plane = np.square(_dot(corner[:, 0], normal)) / np.where(has_area, area, 1.0)
    # (c x e) (e x f) = (c e) (e f) - (c f) (e e), e x f the normal: the projection lies on the
    # inner side of all edges. By rounding alone is the plane ever farther than these.
    inward = offset * _dot(edge, following) - _dot(corner, following) * square
    is_above = has_area & (inward >= 0.0).all(axis=0)
    distances: Floats = np.sqrt(np.minimum(to_edges, np.where(is_above, to_plane, np.inf)))
    return distances


def _dot(a: Floats, b: Floats) -> Floats:
    """(...) products of (3, ...) vectors."""
    products: Floats = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return products
