"""Angle by which the rounding of a scene's coordinates displaces things, seen from a viewpoint.

Renderers hold corners and viewpoint as float32, relative to the centre of the scene. A corner is
off by a part in 2^24 of its distance from there, a point of a triangle by what its farthest corner
is off, and the arithmetic on both by as much again: all are lengths, proportional to the
viewpoint's distance from the centre and to the triangle's size. Over the triangle's distance from
the viewpoint a length is an angle; the largest of all triangles counts. Thousandths of a pixel in
the bundled worlds; tests exceed the bound nowhere in worlds of 2 to 200 km with things 2 to 30 cm
near.

Like the bounds of `distances`, the result holds for all viewpoints of a cell of a fixed grid, and
does not depend on earlier queries. Of four sizes the largest cell counts whose result is little
above its centre's: 2 microseconds a frame, half a millisecond for a new cell.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.bounds.round_outward import MIN_DISTANCE_M, ViewpointCells
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.triangles import (
    Indices,
    make_clusters,
    row_blocks,
    triangle_distances,
)

UNIT_ROUNDOFF = 2.0**-24
"""Largest relative error of rounding to float32."""


@dataclass(frozen=True, slots=True)
class CoordinateErrors:
    """Displacements by a renderer's coordinates, in units of 2^-24."""

    position_ulps: float
    """Of any point, over the viewpoint's distance from the centre of the scene."""
    size_ulps: float
    """Of the points of a triangle, over the sum of its size and distance."""
    miss_m: float = 0.0
    """Not by coordinates: distance at which rays taken to meet in the viewpoint pass it, metres."""


class CoordinateRounding:
    """Displacements in one scene with its dynamic objects."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._centre = scene.centre
        self._objects: dict[ObjectMesh, _NearTriangles] = {}

    @cached_property
    def _triangles(self) -> _NearTriangles:
        # On demand: 0.1 s for a million triangles, which a camera without a bound does not need.
        return _NearTriangles(self._scene.corners)

    def max_angle_rad(
        self, viewpoint: Floats, objects: tuple[DynamicObject, ...], errors: CoordinateErrors
    ) -> float:
        """Angle by which no point is displaced farther; at most pi.

        Args:
            viewpoint: (3,) metres, world frame.
            objects: Dynamic objects in view.
            errors: Errors of the renderer's coordinates.
        """
        position_m = errors.position_ulps * math.dist(viewpoint, self._centre)
        position_m += errors.miss_m / UNIT_ROUNDOFF
        of_scene = self._triangles.proximity(viewpoint)
        angle_ulps = _angle_ulps(of_scene, position_m, errors.size_ulps)
        for one in objects:
            near = self._object_proximity(one, viewpoint)
            # Its corners are rounded in its own frame, within its sphere.
            own_m = 2.0 * errors.size_ulps * one.mesh.radius_m
            angle_ulps = max(angle_ulps, _angle_ulps(near, position_m + own_m, errors.size_ulps))
        return min(angle_ulps * UNIT_ROUNDOFF, math.pi)

    def min_distance_m(self, viewpoint: Floats, objects: tuple[DynamicObject, ...]) -> float:
        """Lower bound of the distance of all triangles from a (3,) viewpoint, metres.

        Two fifths of the nearest one's at least, as in `_NearTriangles`; inf without any.
        """
        near = [self._triangles.proximity(viewpoint)]
        near += [self._object_proximity(one, viewpoint) for one in objects]
        inverse = max(one.inverse_distance_per_m for one in near)
        return 1.0 / inverse if inverse > 0.0 else math.inf

    def _object_proximity(self, one: DynamicObject, viewpoint: Floats) -> _Proximity:
        distance_m = math.dist(viewpoint, one.centre) - one.mesh.radius_m
        # Most objects are far, and then their sphere is exact enough.
        if distance_m > one.mesh.radius_m:
            return _Proximity(1.0 / distance_m, 2.0 * one.mesh.radius_m / distance_m)
        if one.mesh not in self._objects:
            self._objects[one.mesh] = _NearTriangles(one.mesh.corners)
        in_object = one.world_from_object.inverse().transform_points(viewpoint)
        return self._objects[one.mesh].proximity(in_object)


def _angle_ulps(near: _Proximity, position_ulp_m: float, size_ulps: float) -> float:
    return (
        position_ulp_m * near.inverse_distance_per_m
        + size_ulps * near.size_per_distance
        + size_ulps
    )


_CELL_SIDES_M = (0.5, 0.25, 0.0625)
# Half a cell's diagonal over the distance of the nearest triangle: the result is at most 1.5
# times the centre's.
_MAX_CELL_LOSS = 1.0 / 3.0
# Triangles a group, and groups: 0.1 ms a query for a million triangles and more.
_MIN_GROUP_SIZE = 32
_MAX_GROUPS = 16384
# Groups measured at once, for NumPy's overhead.
_BATCH_SIZE = 12
# A group counts with its box, not with its triangles, where that raises a result by less than half.
_MAX_EXCESS = 1.5
_TINY = 1e-30
# Diagonal of a group's box over the diagonal of a square of its share of a surface.
_MAX_BOX_RATIO = 8.0


class _NearTriangles:
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
        self._cells = ViewpointCells(_CELL_SIDES_M, self._proximity_in_cell)

    def proximity(self, viewpoint: Floats) -> _Proximity:
        """Proximity of a (3,) viewpoint, no less than of any in its cell."""
        return self._cells.find(viewpoint)

    def _proximity_in_cell(self, centre: Floats, sides: Floats) -> _Proximity | None:
        """Proximity of a cell; None for a cell too large for its surroundings."""
        of_centre = self._measure(centre)
        # A distance d is at least d - reach everywhere in the cell: 1 / d grows the more the
        # nearer, and the most for the nearest triangle.
        reach_m = 0.5 * float(np.linalg.norm(sides))
        loss = reach_m * of_centre.inverse_distance_per_m
        return of_centre.scale(1.0 / (1.0 - loss)) if loss <= _MAX_CELL_LOSS else None

    def _measure(self, point: Floats) -> _Proximity:
        """Proximity of one (3,) viewpoint."""
        if not len(self._size):
            return _Proximity()
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
        return _Proximity(inverse_distance, size_per_distance)

    def _measure_groups(self, groups: Indices, point: Floats) -> Floats:
        """(2, m) both numbers of groups, from their triangles."""
        rows = (groups[:, None] * self._group_size + np.arange(self._group_size)).ravel()
        # The last group may be shorter: its last triangle counts several times.
        corners = self._corners[np.minimum(rows, len(self._corners) - 1)]
        inverse = _invert(triangle_distances(point, corners))
        both = np.stack((inverse, inverse * _longest_edges(corners)))
        numbers: Floats = both.reshape(2, len(groups), self._group_size).max(axis=-1)
        return numbers


@dataclass(frozen=True, slots=True)
class _Proximity:
    """Upper bounds over all triangles; 0 without any."""

    inverse_distance_per_m: float = 0.0
    """One over the distance of the nearest triangle."""
    size_per_distance: float = 0.0
    """Longest edge of a triangle over its distance."""

    def scale(self, factor: float) -> _Proximity:
        """Both bounds, multiplied."""
        return _Proximity(factor * self.inverse_distance_per_m, factor * self.size_per_distance)


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
        size[block] = _longest_edges(corners[block])
    return low, high, np.maximum.reduceat(size, first)


def _has_large_boxes(low: Floats, high: Floats) -> bool:
    """Whether the boxes of groups are far larger than a divided surface would have."""
    if not len(low):
        return False
    whole_m = float(np.linalg.norm(high.max(axis=0) - low.min(axis=0)))
    mean_m = float(np.linalg.norm(high - low, axis=-1).mean())
    return mean_m > _MAX_BOX_RATIO * whole_m / math.sqrt(len(low))


def _longest_edges(corners: Floats) -> Floats:
    """(n,) lengths of the longest edges of (n, 3, 3) triangles."""
    a, b, c = np.ascontiguousarray(corners.transpose(1, 2, 0))
    squares = [np.square(edge).sum(axis=0) for edge in (b - a, c - b, a - c)]
    longest: Floats = np.sqrt(np.maximum(np.maximum(*squares[:2]), squares[2]))
    return longest


def _invert(distances_m: Floats) -> Floats:
    """One over each distance; a viewpoint may touch a surface."""
    inverse: Floats = 1.0 / np.maximum(distances_m, MIN_DISTANCE_M)
    return inverse
