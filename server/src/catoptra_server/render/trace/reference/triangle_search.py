"""First hits of rays on triangles, in NumPy and float64: a bounding volume hierarchy in arrays.

Every node has four children, and all leaves the same number of triangles: node i has the children
4 i + 1 to 4 i + 4, and no node stores a reference. Rays descend together, each with a stack of its
own, nearest children first. Results depend on ray and triangles alone, neither on other rays nor
on threads.

Watertight: no ray slips between triangles that share an edge. Space is sheared so that the ray is
an axis; an edge's test is a difference of two products of the sheared coordinates, which has the
exact difference's sign or is zero, and is negated exactly where the other triangle runs through the
edge the other way. Zero counts as inside. Boxes are enlarged by more than the shear's rounding.
Twin in float32: `render/trace/kernel/src/bvh.c`.

Source: Woop, Benthin & Wald 2013, "Watertight Ray/Triangle Intersection".
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass

_Float32s = npt.NDArray[np.float32]
_Indices = npt.NDArray[np.int32]
_Rows = npt.NDArray[np.intp]
_CHILDREN = 4
_MAX_LEAF_TRIANGLES = 8
# Rays that descend together: their arrays stay in the cache, and few enough calls are made.
_BLOCK_RAYS = 2**14
# Up to this number all halvings are compared, which makes a third fewer steps and takes six times
# as long.
_MAX_COMPARED = 2**15
# Enlargement of boxes, and the least distance, relative to the coordinates of origins and corners.
# A sheared coordinate loses 5 roundings of 2^-53, and 32 are allowed for.
_MARGIN = 2.0**-48
# Least component of a direction in the boxes' tests, relative to the largest: zero times infinity
# is no number.
_MIN_COMPONENT = 2.0**-500
# An entry of a stack is negative: a box's distance, of which these bits remain, and the node below
# them. The distance is rounded down.
_NEAR_BITS = -(2**32)


class TriangleSearch:
    """Triangles, sorted for ray queries. Thread-safe once built: queries only read."""

    def __init__(self, corners: Floats) -> None:
        """Sort (n, 3, 3) corners. Triangles without a finite, positive area are never met."""
        # Whatever overflows belongs to triangles that are never met.
        with np.errstate(all="ignore"):
            usable = np.flatnonzero(_has_area(corners))
            self._is_empty = len(usable) == 0
            if self._is_empty:
                return
            self._depth = 0
            while len(usable) > _MAX_LEAF_TRIANGLES * _CHILDREN**self._depth:
                self._depth += 1
            leaves = _group(corners[usable], _CHILDREN**self._depth)
            self._numbers: _Indices = np.sort(usable[leaves], axis=-1).astype(np.int32)
        # A row holds one coordinate of a leaf's first corners, second corners and third corners.
        rows = corners[self._numbers].transpose(0, 3, 2, 1).reshape(3 * len(leaves), -1)
        self._corner_rows = rows
        self._box_rows = _stack_boxes(rows.min(axis=1), rows.max(axis=1))
        self._first_leaf = len(self._box_rows) // 6
        self._size = float(np.abs(rows).max())

    filter: Callable[[_Indices, Floats, Floats, float], Bools] | None = None
    """Whether rays pass the (k,) triangles that they meet, by (k, 2) barycentric weights of corners
    1 and 2, (k, 3) directions, and the query's least coverage; None: none does."""

    def first_hits(
        self,
        origins: Floats,
        directions: Floats,
        max_distance: Floats | None = None,
        *,
        begin: Floats | None = None,
        least_coverage: float = 1.0,
    ) -> tuple[Floats, _Indices, Floats]:
        """First hits of rays from (n, 3) origins along (n, 3) directions of any length.

        Of triangles at the same distance the one of the lower number is met. Those on which a ray
        begins, up to rounding, are not.

        Args:
            origins: Starts of the rays.
            directions: Their directions.
            max_distance: (n,) distances before which hits lie; None: all count.
            begin: (n,) distances behind which hits lie; None: those of the origins.
            least_coverage: What blended triangles are met from on, for the filter.

        Returns:
            (n,) distances in lengths of the direction, inf without a hit; (n,) triangles, -1
            without a hit; (n, 2) barycentric weights of corners 1 and 2, zero without a hit.
        """
        count = len(origins)
        limits = np.full(count, np.inf) if max_distance is None else max_distance.astype(np.float64)
        triangle, weights = np.full(count, -1, dtype=np.int32), np.zeros((count, 2))
        if not self._is_empty:
            # Parallel planes divide by zero on purpose: what is no number meets nothing.
            with np.errstate(all="ignore"):
                for start in range(0, count, _BLOCK_RAYS):
                    block = slice(start, start + _BLOCK_RAYS)
                    found = _NearestHits(limits[block], triangle[block], weights[block])
                    rays = _Rays.prepare(
                        origins[block], directions[block], self._size, least_coverage
                    )
                    if begin is not None:
                        np.maximum(rays.shear[3], begin[block], out=rays.shear[3])
                    self._search(rays, found)
        return np.where(triangle >= 0, limits, np.inf), triangle, weights

    def occludes(self, origins: Floats, directions: Floats, max_distance: Floats) -> Bools:
        """(n,) whether a triangle lies before each ray's `max_distance`, as `first_hits` counts."""
        return np.asarray(self.first_hits(origins, directions, max_distance)[1] >= 0)

    def _search(self, rays: _Rays, found: _NearestHits) -> None:
        """Descend from the root, each ray with a stack of its own: nearest nodes on top."""
        width = (_CHILDREN - 1) * self._depth + _CHILDREN
        bottom = np.arange(len(found.distance)) * width
        stack = np.zeros(bottom.size * width, dtype=np.int64)
        top, active = bottom + 1, np.arange(bottom.size)
        while len(active):
            top[active] -= 1
            entry = -stack.take(top.take(active))
            is_near = (entry & _NEAR_BITS).view(np.float64) <= found.distance.take(active)
            active, node = active[is_near], entry[is_near] & ~_NEAR_BITS
            is_leaf = node >= self._first_leaf
            self._meet(active[is_leaf], node[is_leaf] - self._first_leaf, rays, found)
            some = active[~is_leaf]
            if len(some):
                entries, count = self._meet_boxes(some, node[~is_leaf], rays, found)
                stack[top.take(some) + np.arange(_CHILDREN)[:, None]] = entries
                top[some] += count
            active = np.flatnonzero(top > bottom)

    def _meet_boxes(
        self, some: _Rows, parents: _Rows, rays: _Rays, found: _NearestHits
    ) -> tuple[npt.NDArray[np.int64], _Rows]:
        """(4, m) entries of the children whose boxes are met, the farthest first; their numbers."""
        inverse, rows = rays.inverse.take(some, axis=1)[:, None], rays.near_rows.take(some, axis=1)
        parents = parents * 6
        near = _take_rows(self._box_rows, parents + rows, rays.near_origins.take(some, axis=1))
        far = _take_rows(self._box_rows, parents + 5 - rows, rays.far_origins.take(some, axis=1))
        near *= inverse
        far *= inverse
        distance, end = near.max(axis=0), np.minimum(far.min(axis=0), found.distance.take(some))
        is_met = (distance <= end) & (end >= 0.0)
        # Positive float64s are ordered as their bits are; adding zero removes the sign of -0.
        entries = (np.maximum(distance, 0.0) + 0.0).view(np.int64) & _NEAR_BITS
        entries |= parents // 6 * _CHILDREN + np.arange(1, _CHILDREN + 1)[:, None]
        return np.sort(np.where(is_met, -entries, 1), axis=0), is_met.sum(axis=0)

    def _meet(self, some: _Rows, leaves: _Rows, rays: _Rays, found: _NearestHits) -> None:
        """Replace the hits of rays that meet a nearer triangle in their leaf."""
        rows = 3 * leaves + rays.axes.take(some, axis=1)
        corners = _take_rows(self._corner_rows, rows, rays.origins.take(some, axis=1))
        shear = rays.shear.take(some, axis=1)
        x, y, z = corners.reshape(3, 3, self._numbers.shape[1], -1)
        x -= shear[0] * z
        y -= shear[1] * z
        u, v, w = x[2] * y[1] - y[2] * x[1], x[0] * y[2] - y[0] * x[2], x[1] * y[0] - y[1] * x[0]
        total = u + v + w
        lowest, highest = np.minimum(np.minimum(u, v), w), np.maximum(np.maximum(u, v), w)
        distance = (z[0] + (v * (z[1] - z[0]) + w * (z[2] - z[0])) / total) * shear[2]
        is_met = ((lowest >= 0.0) | (highest <= 0.0)) & (distance > shear[3])
        # Beside a triangle as small as rounding, or in its plane, all products round alike.
        for across in (x, y):
            is_met &= (across.min(axis=0) <= 0.0) & (across.max(axis=0) >= 0.0)
        if self.filter is not None:
            slot, column = np.nonzero(is_met)
            met = np.stack((v, w), axis=-1)[slot, column] / total[slot, column, None]
            numbers = self._numbers[leaves[column], slot]
            passes = self.filter(numbers, met, rays.directions[some[column]], rays.least_coverage)
            is_met[slot[passes], column[passes]] = False
        distance = np.where(is_met, distance, np.inf)
        # The first of equals is the one of the lowest number, since leaves are sorted.
        slot, column = distance.argmin(axis=0), np.arange(len(some))
        distance, triangle = distance[slot, column], self._numbers[leaves, slot]
        before = found.distance.take(some)
        is_tie = (distance == before) & (triangle < found.triangle[some])
        (column,) = np.nonzero((distance < before) | is_tie)
        slot, some = slot[column], some[column]
        found.distance[some], found.triangle[some] = distance[column], triangle[column]
        weights = np.stack((v[slot, column], w[slot, column]), axis=1)
        found.weights[some] = weights / total[slot, column, None]


def _take_rows(table: Floats, rows: _Rows, origins: Floats) -> Floats:
    """(3, k, m) differences of (3, m) rows of k coordinates from (3, m) origins.

    Rays come last, so that NumPy's inner loops are long.
    """
    return np.subtract(table.take(rows, axis=0).swapaxes(1, 2), origins[:, None], order="C")


@dataclass(frozen=True, slots=True, eq=False)
class _NearestHits:
    """Hits of n rays so far, replaced by nearer ones."""

    distance: Floats
    triangle: _Indices
    weights: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Rays:
    """n rays, with all that the tests of boxes and triangles need."""

    directions: Floats
    """(n, 3)."""
    axes: _Rows
    """(3, n) order of the axes: the last one is the direction's largest component."""
    origins: Floats
    """(3, n) in that order."""
    shear: Floats
    """(4, n): x and y a z, the distance a z, and the distance from which hits count."""
    inverse: Floats
    """(3, n) inverses of the direction's components."""
    near_rows: _Rows
    """(3, n) rows of the planes at which a ray enters a box; it leaves at rows 5 - these."""
    near_origins: Floats
    """(3, n) origins, moved along the direction to enlarge boxes."""
    far_origins: Floats
    """(3, n) origins, moved against the direction."""
    least_coverage: float
    """For the filter of triangles."""

    @classmethod
    def prepare(
        cls, origins: Floats, directions: Floats, size: float, least_coverage: float
    ) -> _Rays:
        """(n, 3) rays among corners of coordinates up to a size."""
        starts, ways = np.ascontiguousarray(origins.T), np.ascontiguousarray(directions.T)
        axes = (np.abs(ways).argmax(axis=0) + np.array(((1,), (2,), (0,)))) % 3
        x, y, z = np.take_along_axis(ways, axes, axis=0)
        least = _MIN_COMPONENT * np.abs(z)
        inverse = 1.0 / np.where(np.abs(ways) < least, np.copysign(least, ways), ways)
        margin = _MARGIN * (np.abs(starts).max(axis=0) + size)
        step = np.copysign(margin, ways)
        return cls(
            directions,
            axes,
            np.take_along_axis(starts, axes, axis=0),
            np.stack((x / z, y / z, 1.0 / z, margin / np.abs(z))),
            inverse,
            np.where(np.signbit(ways), ((5,), (4,), (3,)), ((0,), (1,), (2,))),
            starts + step,
            starts - step,
            least_coverage,
        )


def _has_area(corners: Floats) -> Bools:
    """(n,) whether a triangle's area is finite and not zero."""
    edges = corners[:, 1:] - corners[:, :1]
    area = np.cross(edges[:, 0], edges[:, 1])
    return np.asarray(np.isfinite(area).all(axis=1) & area.any(axis=1))


def _group(corners: Floats, num_groups: int) -> _Rows:
    """(groups, k) rows of (n, 3, 3) corners, halved repeatedly by a coordinate of their boxes.

    Large triangles are so grouped with large ones. Some are repeated, so that all groups are equal.
    """
    count = -(-len(corners) // num_groups) * num_groups
    order = np.resize(np.arange(len(corners)), count)
    # Which triangles are together changes no hit: float32 is exact enough and faster.
    a, b, c = (corners - corners[0, 0]).astype(np.float32).transpose(1, 2, 0)
    lower, upper = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    boxes = np.concatenate((lower, upper)).take(order, axis=1)
    size = count
    while size > count // num_groups:
        grouped = boxes.reshape(6, -1, size)
        groups = np.arange(grouped.shape[1])
        if count > _MAX_COMPARED:
            longest = (grouped.max(axis=2) - grouped.min(axis=2)).argmax(axis=0)
            halves = np.argpartition(grouped[longest, groups], size // 2, axis=1)
        else:
            options = np.argpartition(grouped, size // 2, axis=2)
            halves = options[_halved_areas(grouped, options).argmin(axis=0), groups]
        rows = (halves + size * groups[:, None]).reshape(-1)
        order, boxes = order[rows], boxes.take(rows, axis=1)
        size //= 2
    return order.reshape(num_groups, -1)


def _halved_areas(grouped: _Float32s, options: _Rows) -> _Float32s:
    """(6, groups) sums of the surface areas of the two halves' boxes, by each order of boxes."""
    ordered = np.take_along_axis(grouped[:, None], options[None], axis=3)
    halves = ordered.reshape(*ordered.shape[:3], 2, -1)
    sides = halves[3:].max(axis=-1) - halves[:3].min(axis=-1)
    return np.asarray((sides * np.roll(sides, 1, axis=0)).sum(axis=(0, -1)))


def _stack_boxes(lower: Floats, upper: Floats) -> Floats:
    """(6 m, 4) planes of the children's boxes of all m inner nodes: lower x, y, z, upper z, y, x.

    By the (3 leaves,) coordinates of the leaves' lower and of their upper corners.
    """
    boxes = np.concatenate((lower.reshape(-1, 3), -upper.reshape(-1, 3)[:, ::-1]), axis=1)
    levels = [np.zeros((0, 6, _CHILDREN))]
    while len(boxes) > 1:
        children = boxes.reshape(-1, _CHILDREN, 6)
        levels.insert(0, children.swapaxes(1, 2))
        boxes = children.min(axis=1)
    planes = np.concatenate(levels)
    planes[:, 3:] *= -1.0
    return np.ascontiguousarray(planes.reshape(-1, _CHILDREN))
