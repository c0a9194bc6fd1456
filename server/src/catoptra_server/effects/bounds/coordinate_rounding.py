"""Rounding: of a scene's coordinates, as an angle, and of bounds and viewpoints, outward.

Coordinates: the angle by which the rounding of a scene's coordinates displaces things, seen from a
viewpoint. Trace holds corners and viewpoint as float32, relative to the centre of the scene; in
large worlds it meets corners in float64 relative to the viewpoint, and no size matters. A
corner is off by a part in 2^24 of its distance from there, a point of a triangle by what its
farthest corner is off, and the arithmetic on both by as much again: all are lengths, proportional
to the viewpoint's distance from the centre and to the triangle's size. Over the triangle's distance
from the viewpoint a length is an angle; the largest of all triangles counts. Raster's coordinates
are relative to the viewpoint, and it splits triangles that are large for their distance
(`render/projection/large_triangles.py`): only size over distance is left, and that has a limit.
Thousandths of a pixel in the bundled worlds; tests exceed the bound nowhere in worlds of 2 to 200
km with things 2 to 30 cm near.

Like the bounds of `distances`, the result holds for all viewpoints of a cell of a fixed grid, and
does not depend on earlier queries. Of four sizes the largest cell counts whose result is little
above its centre's: 4 microseconds a frame, 0.2 ms for a new cell, 0.6 among a million triangles.

Bounds are rounded outward to eighths of an octave, viewpoints to cells. A driving robot then
changes the bounds rarely, and a decision made from them holds for many frames. Rounding costs at
most 9 % of a bound (2^(1/8) = 1.09).

All viewpoints of a cell share a bound. Cells belong to fixed grids and do not depend on earlier
frames: a frame follows from its camera state alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Iterator
from functools import lru_cache
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from catoptra_protocol.optics.elementary import einsum, hypot, matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.triangles import Indices, TriangleHierarchy, triangle_distances
from catoptra_server.world.world_description import Twist, Vector3

# Criteria divide by distances.
MIN_DISTANCE_M = 1e-6


def round_down(distances_m: Iterable[float]) -> tuple[float, ...]:
    """Distances rounded down, none below MIN_DISTANCE_M."""
    return tuple(map(_round_value_down, distances_m))


def round_away_from_zero(values: Iterable[float]) -> tuple[float, ...]:
    """Rates rounded away from zero."""
    return tuple(map(_round_value_away, values))


def round_twist(twist: Twist) -> Twist:
    """Twist with each component rounded away from zero, in sixteenths of the vector's octave."""
    return Twist(_round_vector(twist.linear_m_s), _round_vector(twist.angular_rad_s))


# From 1 / 2 up: eight powers of the eighth root of 2.
_STEPS_OF_OCTAVE = tuple(
    (0.5 * np.cumprod([1.0, *(math.sqrt(math.sqrt(math.sqrt(2.0))),) * 7])).tolist()
)
_STEPS_PER_VECTOR = 16

# Below a nanometre a second there is only rounding, whose changing sign would change the bound.
_MIN_RATE = 1e-9


def _round_vector(values: Vector3) -> Vector3:
    length = hypot(*values)
    if length < _MIN_RATE:
        return 0.0, 0.0, 0.0
    # Steps of the whole vector, not of each component: a component near zero would otherwise pass
    # through many octaves.
    step = math.ldexp(1.0, math.frexp(length)[1]) / _STEPS_PER_VECTOR
    x, y, z = (
        math.copysign(step * math.ceil(abs(v) / step), v) if abs(v) >= _MIN_RATE else 0.0
        for v in values
    )
    return x, y, z


def _round_value_down(value: float) -> float:
    if math.isinf(value):
        return value
    fraction, exponent = math.frexp(max(value, MIN_DISTANCE_M))
    step = max(step for step in _STEPS_OF_OCTAVE if step <= fraction)
    return max(math.ldexp(step, exponent), MIN_DISTANCE_M)


def _round_value_away(value: float) -> float:
    if math.isinf(value):
        return value
    if abs(value) < _MIN_RATE:
        return 0.0
    fraction, exponent = math.frexp(abs(value))
    step = min(step for step in (*_STEPS_OF_OCTAVE, 1.0) if step >= fraction)
    return math.copysign(math.ldexp(step, exponent), value)


_BoundT = TypeVar("_BoundT")
# Robots drive on floors: above one, a cell may be wide and must be low.
_CELL_HEIGHT_FRACTION = 0.125
# Side of a single viewpoint's cell, a nanometre: a camera on a robot rests in the robot's frame but
# for rounding. Under a thousandth of any distance that a bound has.
POINT_M = 2.0**-30
# 100 bytes an entry; a driving robot needs five new ones a second.
_CACHE_SIZE = 8192


class ViewpointCells(Generic[_BoundT]):
    """Bounds in cells of viewpoints, each evaluated once."""

    def __init__(self, sides_m: tuple[float, ...], evaluate: Callable[..., _BoundT | None]) -> None:
        """Evaluate nothing yet.

        Args:
            sides_m: Sides of cells, largest first. A viewpoint too near a surface for the smallest
                is evaluated in a cell of `POINT_M`: a robot would leave others in every frame.
            evaluate: Bound in a cell, of its (3,) centre and (3,) sides and of further keys; None
                for a cell too large for its surroundings, but for `POINT_M`.
        """
        self._sides_m = (*sides_m, POINT_M)
        self._evaluate = evaluate
        # Per instance: a cache on the class would keep scenes alive.
        self._find_cached = lru_cache(maxsize=_CACHE_SIZE)(self._find_in_cell)

    @property
    def num_evaluations(self) -> int:
        """Number of viewpoints and cells evaluated so far, for tests and measurements."""
        return self._find_cached.cache_info().misses

    def find(self, viewpoint: Floats, *keys: Hashable) -> _BoundT:
        """Bound in the largest cell around a (3,) viewpoint that has one."""
        x, y, z = viewpoint.tolist()
        for side in self._sides_m:
            cell = (round(x / side), round(y / side), round(z / (_CELL_HEIGHT_FRACTION * side)))
            found = self._find_cached(cell, side, *keys)
            if found is not None:
                return found
        raise AssertionError("a single viewpoint has a bound")

    def _find_in_cell(self, cell: Vector3, side: float, *keys: Hashable) -> _BoundT | None:
        sides = side * np.array((1.0, 1.0, _CELL_HEIGHT_FRACTION))
        return self._evaluate(sides * cell, sides, *keys)


UNIT_ROUNDOFF = 2.0**-24
"""Largest relative error of rounding to float32."""


@dataclass(frozen=True, slots=True)
class CoordinateErrors:
    """Displacements by a renderer's coordinates, in units of 2^-24."""

    position_ulps: float
    """Of any point, over the viewpoint's distance from the centre of the scene."""
    size_ulps: float
    """Of the points of a triangle, over the sum of its size and distance."""
    max_size_per_distance: float = math.inf
    """Size over distance above which the renderer splits triangles."""
    object_ulps: float = 0.0
    """Of the points of a dynamic object, over its radius: rounded in its own frame."""


class CoordinateRounding:
    """Displacements in one scene with its dynamic objects."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._triangles = _NearTriangles(scene.hierarchy())
        self._objects: dict[ObjectMesh, _NearTriangles] = {}

    def max_angle_rad(
        self, viewpoint: Floats, objects: tuple[DynamicObject, ...], errors: CoordinateErrors
    ) -> float:
        """The angle by which no point is displaced farther; at most pi.

        Args:
            viewpoint: (3,) metres, world frame.
            objects: Dynamic objects in view.
            errors: Errors of the renderer's coordinates.
        """
        centre_m = hypot(*(viewpoint - self._scene.centre).tolist())
        position_m = errors.position_ulps * centre_m
        angle_ulps = self._triangles.proximity(viewpoint).angle_ulps(position_m, errors)
        # A camera far from the centre is the origin of its frames' objects.
        if self._scene.is_far(viewpoint):
            position_m = 0.0
        for one, near in zip(objects, self._object_proximities(objects, viewpoint), strict=True):
            own_m = position_m + errors.object_ulps * one.mesh.radius_m
            angle_ulps = max(angle_ulps, near.angle_ulps(own_m, errors))
        return min(angle_ulps * UNIT_ROUNDOFF, math.pi)

    def min_distance_m(self, viewpoint: Floats, objects: tuple[DynamicObject, ...]) -> float:
        """Lower bound of the distance of all triangles from a (3,) viewpoint, metres.

        Two fifths of the nearest one's at least, as in `_NearTriangles`; inf without any.
        """
        near = (self._triangles.proximity(viewpoint), *self._object_proximities(objects, viewpoint))
        inverse = max(one.inverse_distance_per_m for one in near)
        return 1.0 / inverse if inverse > 0.0 else math.inf

    def _object_proximities(
        self, objects: tuple[DynamicObject, ...], viewpoint: Floats
    ) -> Iterator[_Proximity]:
        point = viewpoint.tolist()
        for one in objects:
            radius_m = one.mesh.radius_m
            distance_m = _centre_distance_m(one, point) - radius_m
            # Most objects are far, and then their sphere is exact enough.
            if distance_m > radius_m:
                yield _Proximity(1.0 / distance_m, 2.0 * radius_m / distance_m)
                continue
            if one.mesh not in self._objects:
                self._objects[one.mesh] = _NearTriangles(TriangleHierarchy(one.mesh.corners))
            pose = one.world_from_object
            yield self._objects[one.mesh].proximity(
                matmul(viewpoint - pose.translation, pose.rotation)
            )


def _centre_distance_m(one: DynamicObject, point: list[float]) -> float:
    """Distance of an object's centre from a point of the world, metres."""
    # Plain floats: for all objects in every frame, in half the time of arrays of three.
    pose, (x, y, z) = one.world_from_object, one.mesh.centre.tolist()
    rows = zip(pose.rotation.tolist(), pose.translation.tolist(), strict=True)
    centre = [a * x + b * y + c * z + origin for (a, b, c), origin in rows]
    return float(hypot(*(p - q for p, q in zip(point, centre, strict=True))))


class _Proximity(NamedTuple):
    """Upper bounds over all triangles; 0 without any."""

    inverse_distance_per_m: float = 0.0
    """One over the distance of the nearest triangle."""
    size_per_distance: float = 0.0
    """Longest edge of a triangle over its distance."""

    def angle_ulps(self, position_ulp_m: float, errors: CoordinateErrors) -> float:
        """Angle of a displacement by a length, and by a multiple of size and distance."""
        size_per_distance = min(self.size_per_distance, errors.max_size_per_distance)
        by_position = position_ulp_m * self.inverse_distance_per_m
        return by_position + errors.size_ulps * (size_per_distance + 1.0)


_CELL_SIDES_M = (0.5, 0.25, 0.0625)
# Half a cell's diagonal over the distance of the nearest triangle: the result is at most 1.5
# times the centre's.
_MAX_CELL_LOSS = 1.0 / 3.0
# Groups measured at once, for NumPy's overhead.
_BATCH_SIZE = 64
# A group counts with its box, not with its triangles, where that raises no result by more.
_MAX_EXCESS = 1.1
_TINY = 1e-30


class _NearTriangles:
    """Proximities of the triangles of a hierarchy."""

    def __init__(self, triangles: TriangleHierarchy) -> None:
        self._triangles = triangles
        self._cells = ViewpointCells(_CELL_SIDES_M, self._proximity_in_cell)

    def proximity(self, viewpoint: Floats) -> _Proximity:
        """Proximity of a (3,) viewpoint, no less than of any in its cell."""
        return self._cells.find(viewpoint)

    def _proximity_in_cell(self, centre: Floats, sides: Floats) -> _Proximity | None:
        """Proximity of a cell; None for a cell too large for its surroundings."""
        if not self._triangles.levels[0].size:
            return _Proximity()
        # A distance d is at least d - reach everywhere in the cell: 1 / d grows the more the
        # nearer, and the most for the nearest triangle.
        reach_m = 0.5 * hypot(*sides)
        max_inverse = _MAX_CELL_LOSS / reach_m
        near = self._find_near_groups(centre, max_inverse)
        inverse, size = self._measure(centre, *near) if near is not None else (math.inf, math.inf)
        if inverse > max_inverse:
            return None
        factor = 1.0 / (1.0 - reach_m * inverse)
        return _Proximity(factor * inverse, factor * size)

    def _measure(
        self, point: Floats, groups: Indices, bounds: Floats, found: Floats
    ) -> tuple[float, float]:
        """Both numbers of one (3,) viewpoint, by what `_find_near_groups` returned."""
        limit = 1.0
        while True:
            # Groups whose box alone would raise either result the most.
            excess = (bounds / found).max(axis=0)
            nearest = np.flatnonzero(excess > limit)
            if not len(nearest):
                break
            if len(nearest) > _BATCH_SIZE:
                nearest = nearest[np.argpartition(excess[nearest], -_BATCH_SIZE)[-_BATCH_SIZE:]]
            # Each group is measured once at most: its numbers exceed none that were found.
            bounds[:, nearest] = self._measure_groups(groups[nearest], point)
            found = np.maximum(found, bounds[:, nearest].max(axis=1, keepdims=True))
            limit = _MAX_EXCESS
        inverse, size = bounds.max(axis=1).tolist()
        return inverse, size

    def _find_near_groups(
        self, point: Floats, max_inverse: float
    ) -> tuple[Indices, Floats, Floats] | None:
        """Groups near a (3,) viewpoint.

        Returns:
            (m,) groups, among them all with a triangle that decides; the (2, m) most that both
            numbers of `_Proximity` can be for them; and (2, 1) least that they are for all. None
            where a triangle is nearer than 1 / max_inverse.
        """
        levels = self._triangles.levels
        roots = np.arange(levels[-1].shape[1])
        of_roots = _bound_boxes(levels[-1], point)
        found = np.maximum(of_roots[1].max(axis=1, keepdims=True), _TINY)
        # First one path for each number: what its end shows leaves few of the other boxes.
        for is_path in (True, False):
            boxes, (bounds, least) = roots, of_roots
            for level in range(len(levels) - 1, 0, -1):
                kept = least.argmax(axis=1) if is_path else (bounds >= found).any(axis=0)
                _, boxes = self._triangles.children(level, boxes[kept])
                bounds, least = _bound_boxes(levels[level - 1].take(boxes, axis=1), point)
                found = np.maximum(found, least.max(axis=1, keepdims=True))
            if found[0] > max_inverse:
                return None
        return boxes, bounds, found

    def _measure_groups(self, groups: Indices, point: Floats) -> Floats:
        """(2, m) both numbers of groups, from their triangles."""
        rows = self._triangles.rows(groups)
        distances = triangle_distances(point, self._triangles.corners[rows.ravel()])
        inverse = _invert(distances).reshape(rows.shape)
        both = np.stack((inverse, inverse * self._triangles.sizes[rows]))
        numbers: Floats = both.max(axis=-1)
        return numbers


def _bound_boxes(boxes: Floats, point: Floats) -> Floats:
    """(2, 2, m) most and least that both numbers of `_Proximity` can be for the triangles in boxes.

    Args:
        boxes: (7, m), as of `TriangleHierarchy.levels`.
        point: (3,) viewpoint.
    """
    below, above = (boxes[:6] - np.concatenate((point, -point))[:, None]).reshape(2, 3, -1)
    # From the nearest point of a box, and from its farthest corner.
    sides = np.stack((np.maximum(np.maximum(below, above), 0.0), np.minimum(below, above)))
    inverse = _invert(np.sqrt(einsum("kij,kij->kj", sides, sides)))
    return np.stack((inverse, inverse * -boxes[6]), axis=1)


def _invert(distances_m: Floats) -> Floats:
    """One over each distance; a viewpoint may touch a surface."""
    inverse: Floats = 1.0 / np.maximum(distances_m, MIN_DISTANCE_M)
    return inverse
