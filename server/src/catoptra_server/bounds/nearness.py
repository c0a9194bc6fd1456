"""How near a viewpoint is to triangles: at a distance in metres, and in units of their own size.

Like the distance bounds of effects (`distance_bound_cache`), the result holds for all viewpoints of
a cell of a fixed grid, and does not depend on earlier queries. Of four sizes the largest cell
counts whose result is little above that of its centre.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.round_outward import MIN_DISTANCE_M
from catoptra_server.world.triangles import make_clusters, row_blocks, triangle_distances
from catoptra_server.world.world_description import Vector3

Indices = npt.NDArray[np.intp]

# Largest first. A viewpoint too near for the smallest is evaluated on its own.
_CELL_SIDES_M = (0.5, 0.25, 0.0625)
# Robots drive on floors: above one, a cell may be wide and must be low.
_CELL_HEIGHT_FRACTION = 0.125
# Half a cell's diagonal over the distance of the nearest triangle: the result is 1.5 times that of
# the centre at most.
_MAX_CELL_LOSS = 1.0 / 3.0
_CACHE_SIZE = 4096
# Triangles a group, and groups: 0.1 ms a query for a million triangles and more.
_MIN_GROUP_SIZE = 32
_MAX_GROUPS = 16384
# Groups measured at once, for NumPy's overhead.
_BATCH_SIZE = 12
# A group counts with its box, not with its triangles, where that raises a result by less than half.
_MAX_EXCESS = 1.5
_TINY = 1e-30
# Diagonal of a group's box over that of a square of its share of a surface.
_MAX_BOX_RATIO = 8.0


@dataclass(frozen=True, slots=True)
class Nearness:
    """Upper bounds over all triangles; 0 without any."""

    inverse_distance_per_m: float = 0.0
    """One over the distance of the nearest triangle."""
    size_per_distance: float = 0.0
    """Longest edge of a triangle over its distance."""

    def scale(self, factor: float) -> Nearness:
        """Both bounds, multiplied."""
        return Nearness(factor * self.inverse_distance_per_m, factor * self.size_per_distance)


class NearTriangles:
    """Triangles in groups, prepared for queries."""

    def __init__(self, corners: Floats) -> None:
        """Keep (n, 3, 3) corners, and find the box and the longest edge of each group."""
        self._group_size = max(_MIN_GROUP_SIZE, -(-len(corners) // _MAX_GROUPS))
        groups = _summarize_groups(corners, self._group_size)
        # Neighbours in a file are most often neighbours in space, and to sort a million triangles
        # takes 0.4 s: only an order without any sense is mended.
        if _has_large_boxes(*groups[:2]):
            corners = corners[make_clusters(corners, np.zeros(len(corners), dtype=np.intp)).order]
            groups = _summarize_groups(corners, self._group_size)
        self._corners = corners
        self._low, self._high, self._size = groups
        # Per instance: a cache on the class would keep scenes alive.
        self._cached_in_cell = lru_cache(maxsize=_CACHE_SIZE)(self._nearness_in_cell)
        self._cached_at_point = lru_cache(maxsize=_CACHE_SIZE)(self._nearness_at_point)

    @property
    def num_evaluations(self) -> int:
        """Number of viewpoints and cells evaluated so far, for tests and measurements."""
        return self._cached_in_cell.cache_info().misses + self._cached_at_point.cache_info().misses

    def nearness(self, viewpoint: Floats) -> Nearness:
        """Nearness of a (3,) viewpoint, no less than that of any in its cell."""
        x, y, z = viewpoint.tolist()
        for side in _CELL_SIDES_M:
            cell = (round(x / side), round(y / side), round(z / (_CELL_HEIGHT_FRACTION * side)))
            found = self._cached_in_cell(cell, side)
            if found is not None:
                return found
        return self._cached_at_point((x, y, z))

    def _nearness_in_cell(self, cell: tuple[int, int, int], side: float) -> Nearness | None:
        """Nearness of a cell; None for a cell too large for its surroundings."""
        sides = side * np.array((1.0, 1.0, _CELL_HEIGHT_FRACTION))
        of_centre = self._measure(sides * cell)
        # A distance d is at least d - reach everywhere in the cell: 1 / d grows the more the
        # nearer, and the most for the nearest triangle.
        reach_m = 0.5 * float(np.linalg.norm(sides))
        loss = reach_m * of_centre.inverse_distance_per_m
        return of_centre.scale(1.0 / (1.0 - loss)) if loss <= _MAX_CELL_LOSS else None

    def _nearness_at_point(self, point: Vector3) -> Nearness:
        return self._measure(np.array(point))

    def _measure(self, point: Floats) -> Nearness:
        """Nearness of one (3,) viewpoint."""
        if not len(self._size):
            return Nearness()
        outside_m = np.maximum(np.maximum(self._low - point, point - self._high), 0.0)
        inverse = _invert(np.sqrt(np.square(outside_m).sum(axis=-1)))
        bounds = np.stack((inverse, inverse * self._size))
        found = np.full((2, 1), _TINY)
        while True:
            # Groups whose box alone would raise either result the most.
            excess = (bounds / found).max(axis=0)
            nearest = np.flatnonzero(excess > _MAX_EXCESS)
            if not len(nearest):
                break
            if len(nearest) > _BATCH_SIZE:
                nearest = nearest[np.argpartition(excess[nearest], -_BATCH_SIZE)[-_BATCH_SIZE:]]
            # Each group is measured once at most: its numbers exceed none that were found.
            bounds[:, nearest] = self._measure_groups(nearest, point)
            found = np.maximum(found, bounds[:, nearest].max(axis=1, keepdims=True))
        inverse_distance, size_per_distance = bounds.max(axis=1).tolist()
        return Nearness(inverse_distance, size_per_distance)

    def _measure_groups(self, groups: Indices, point: Floats) -> Floats:
        """(2, m) both numbers of groups, from their triangles."""
        rows = (groups[:, None] * self._group_size + np.arange(self._group_size)).ravel()
        # The last group may be shorter: its last triangle counts several times.
        corners = self._corners[np.minimum(rows, len(self._corners) - 1)]
        inverse = _invert(triangle_distances(point, corners))
        both = np.stack((inverse, inverse * longest_edges(corners)))
        numbers: Floats = both.reshape(2, len(groups), self._group_size).max(axis=-1)
        return numbers


def _summarize_groups(corners: Floats, group_size: int) -> tuple[Floats, Floats, Floats]:
    """(g, 3) least and greatest coordinates of groups of rows, and (g,) longest edges."""
    if not len(corners):
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    first = np.arange(0, len(corners), group_size)
    rows = corners.reshape(-1, 9)
    low = np.minimum.reduceat(rows, first).reshape(-1, 3, 3).min(axis=1)
    high = np.maximum.reduceat(rows, first).reshape(-1, 3, 3).max(axis=1)
    size = np.zeros(len(corners))
    for block in row_blocks(len(corners)):
        size[block] = longest_edges(corners[block])
    return low, high, np.maximum.reduceat(size, first)


def _has_large_boxes(low: Floats, high: Floats) -> bool:
    """Whether the boxes of groups are far larger than those of a divided surface would be."""
    if not len(low):
        return False
    whole_m = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    mean_m = float(np.linalg.norm(high - low, axis=-1).mean())
    return mean_m > _MAX_BOX_RATIO * whole_m / math.sqrt(len(low))


def longest_edges(corners: Floats) -> Floats:
    """(n,) lengths of the longest edges of (n, 3, 3) triangles."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    squares = [np.square(edge).sum(axis=0) for edge in (b - a, c - b, a - c)]
    longest: Floats = np.sqrt(np.maximum(np.maximum(*squares[:2]), squares[2]))
    return longest


def _invert(distances_m: Floats) -> Floats:
    """One over each distance; a viewpoint may touch a surface."""
    inverse: Floats = 1.0 / np.maximum(distances_m, MIN_DISTANCE_M)
    return inverse
