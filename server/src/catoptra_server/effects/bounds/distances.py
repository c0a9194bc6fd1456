"""Distance bounds of the static scene: no ring of the image shows a surface that is nearer.

A ring is a band of angles theta about the optical axis, at any azimuth. So a box counts as the
solid of revolution that it sweeps about the axis: a rectangle of (rho, z). The rectangle's nearest
point within a band is its nearest point to the viewpoint, if in the band, or lies on one of the
band's two borders.

Triangles are bounded in a hierarchy of boxes: neighbours share a box, neighbouring boxes a larger
one. A query holds for all viewpoints of a box at once, so its result can be cached. A triangle is
bounded by its own box, rotated with the optical axis, and by its own plane; a box that looks small
counts as a whole. So the time of a query follows from what is near and large, however many
triangles that is made of. Occlusion is not considered: a hidden triangle counts.

Of four sizes of cells the largest counts whose bound is little below its centre's. Cells are lower
than wide: above an open floor, half a metre up or down would change the bound by far more than half
a metre sideways. Tilted mirrors share axes, too: a robot that rocks over a step field has another
axis in every frame, and a bound of its own took 5 ms of each.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.elementary import arccos, arctan, arctan2, cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import NUM_RINGS
from catoptra_server.effects.bounds.coordinate_rounding import POINT_M, ViewpointCells, round_down
from catoptra_server.world.shapes import facet_normals
from catoptra_server.world.triangles import TriangleHierarchy
from catoptra_server.world.world_description import Vector3

_CELL_SIDES_M = (0.5, 0.25, 0.125, 0.0625)
# A cell's bound may be this fraction of its centre's.
_MIN_BOUND_FRACTION = 0.7
# A ring this many times farther than the nearest may lose any fraction: the nearest ring dominates
# the criteria.
_FAR_RATIO = 4.0
# Within 1e-6 rad, a tenth of the padding of boxes.
_AXIS_DIGITS = 6
# Of the level components of axes that tilted mirrors share; lenses that look ahead have their own.
_AXIS_STEP = 1.0 / 32.0
_MAX_TILT_RAD = math.radians(45.0)
# An axis is nearer to its shared one: half a step's diagonal, over the cosine of the largest tilt
# and that of half a step more.
_AXIS_ERROR_RAD = 1.1 * _AXIS_STEP
_RingDistances = tuple[float, ...]


class DistanceBoundCache:
    """Distance bounds of one scene."""

    def __init__(self, triangles: TriangleHierarchy) -> None:
        self._triangles = triangles
        self._cells = ViewpointCells(_CELL_SIDES_M, self._bounds_in_cell)

    @property
    def num_evaluations(self) -> int:
        """Number of viewpoints and cells evaluated so far, for tests and measurements."""
        return self._cells.num_evaluations

    def min_distances_m(self, world_from_mirror: Pose, camera: RadialCamera) -> _RingDistances:
        """Distance bound of each ring of the image, rounded down.

        Args:
            world_from_mirror: Pose of the mirror frame; its origin is the viewpoint.
        """
        axis, error_rad = _share_axis(mirror_axis(world_from_mirror))
        return self._cells.find(world_from_mirror.translation, camera, axis, error_rad)

    def _bounds_in_cell(
        self,
        centre: Floats,
        sides: Floats,
        camera: RadialCamera,
        axis: Vector3,
        axis_error_rad: float,
    ) -> _RingDistances | None:
        """Bounds of a cell; None for a cell too large for its surroundings."""
        rings, rotation = image_rings(camera, axis_error_rad), rotation_to_axis(axis)
        box = ViewpointBox(centre, 0.5 * sides, rotation)
        if sides[0] == POINT_M:
            return round_down(bound_ring_distances(self._triangles, box, rings).tolist())
        point = ViewpointBox(centre, np.zeros(3), rotation)
        at_centre = bound_ring_distances(self._triangles, point, rings)
        # A surface nearer than a cell's side: some viewpoint of the cell could touch the surface.
        if at_centre.min() < sides.max():
            return None
        cutoff = _MIN_BOUND_FRACTION * at_centre
        nearest = bound_ring_distances(self._triangles, box, rings, cutoff=cutoff)
        is_far = nearest >= _FAR_RATIO * nearest.min()
        is_fine = ((nearest >= cutoff) | is_far).all() and nearest.min() > 0.0
        return round_down(nearest.tolist()) if is_fine else None


def mirror_axis(world_from_mirror: Pose) -> Vector3:
    """Mirror axis in the world, rounded, so that all upright robots share one."""
    x, y, z = world_from_mirror.rotation[:, 2].tolist()
    # -0.0 + 0.0 is 0.0: one cache key for both zeros.
    return round(x, _AXIS_DIGITS) + 0.0, round(y, _AXIS_DIGITS) + 0.0, round(z, _AXIS_DIGITS) + 0.0


def _share_axis(axis: Vector3) -> tuple[Vector3, float]:
    """Axis that stands for all near a given one, and the angle by which these are off, at most."""
    x, y, z = axis
    if (x, y) == (0.0, 0.0) or abs(z) < cos(_MAX_TILT_RAD):
        return axis, 0.0
    x, y = (_AXIS_STEP * round(value / _AXIS_STEP) + 0.0 for value in (x, y))
    return (x, y, math.copysign(math.sqrt(1.0 - x * x - y * y), z)), _AXIS_ERROR_RAD


@lru_cache(maxsize=64)
def rotation_to_axis(axis: Vector3) -> Floats:
    """Smallest (3, 3) rotation into axes whose z is a given axis.

    The smallest one keeps world-aligned boxes aligned under an upright mirror, where bounds of
    rotated boxes would be looser.
    """
    x, y, z = np.asarray(axis) / hypot(*axis)
    # 1 / (1 + z) has a pole at the axis straight up, of a camera upside down: turn by half a
    # revolution first.
    if z < 0.0:
        return np.array([1.0, -1.0, -1.0])[:, None] * _rotation_to_upward_axis(-x, -y, -z)
    return _rotation_to_upward_axis(x, y, z)


def _rotation_to_upward_axis(x: float, y: float, z: float) -> Floats:
    """Rotation about (y, -x, 0) that takes (x, y, z) to (0, 0, 1); z >= 0."""
    c = 1.0 / (1.0 + z)
    return np.array(
        [[1.0 - c * x * x, -c * x * y, -x], [-c * x * y, 1.0 - c * y * y, -y], [x, y, z]]
    )


# Boxes grow by this fraction of their distance on all sides: frames are rendered in float32, so a
# surface just beside a ring can appear in the ring. Some 0.003 px at 640 px.
_RELATIVE_PADDING = 1e-5
# Replaces a sine or cosine of 0: axis and horizon are borders of bands.
_MIN_DIVISOR = 1e-18


@dataclass(frozen=True, slots=True, eq=False)
class ImageRings:
    """Borders of a camera's rings, from the axis to the rim; (NUM_RINGS + 1,) each."""

    edges_rad: Floats
    """Incidence angles."""
    inverse_sines: Floats
    """1 / sin of them, finite on the axis."""
    inverse_cosines: Floats
    """1 / cos of them, finite at the horizon."""
    padding_rad: float
    """Angle beside a ring that counts with the ring."""


@lru_cache(maxsize=16)
def image_rings(camera: RadialCamera, axis_error_rad: float = 0.0) -> ImageRings:
    """Rings of a camera by its exact projection; a mesh may show a direction in the next ring.

    Args:
        axis_error_rad: Angle between the axis and the one that rings are about, at most.
    """
    radius_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    t = camera.t_from_radius_px(radius_px)
    edges_rad = 2.0 * arctan(t)
    cosines = cos(edges_rad)
    return ImageRings(
        edges_rad,
        inverse_sines=1.0 / np.maximum(sin(edges_rad), _MIN_DIVISOR),
        inverse_cosines=1.0 / np.where(np.abs(cosines) < _MIN_DIVISOR, _MIN_DIVISOR, cosines),
        padding_rad=_RELATIVE_PADDING + axis_error_rad,
    )


def box_distance_bounds(low: Floats, high: Floats, rings: ImageRings) -> Floats:
    """Distance within which each ring shows nothing of a box; inf: the box is not in the ring.

    Args:
        low: (n, 3) lower corners from the viewpoint, in axes whose z is the optical axis.
        high: (n, 3) upper corners.

    Returns:
        (n, NUM_RINGS) metres.
    """
    near = np.maximum(np.maximum(low, -high), 0.0)
    far = np.maximum(-low, high)
    rho_high = hypot(far[:, 0], far[:, 1])
    pad = rings.padding_rad * (rho_high + far[:, 2])
    rho_low = np.maximum(hypot(near[:, 0], near[:, 1]) - pad, 0.0)
    return _rectangle_distance_bounds(
        (rho_low, rho_high + pad), (low[:, 2] - pad, high[:, 2] + pad), rings
    )


def _rectangle_distance_bounds(
    rho: tuple[Floats, Floats], z: tuple[Floats, Floats], rings: ImageRings
) -> Floats:
    """(n, NUM_RINGS) distances of (rho, z) rectangles, each given from low to high."""
    # The z of the rectangle nearest to 0.
    level = np.maximum(z[0], 0.0) + np.minimum(z[1], 0.0)
    direct = hypot(rho[0], level)[:, None]
    theta = arctan2(rho[0], level)[:, None]
    edges = rings.edges_rad
    inside = (edges[:-1] <= theta) & (theta <= edges[1:])
    # Along a border the ray is (r sin theta, r cos theta): r at the rectangle's four sides.
    z_low, z_high = (border[:, None] * rings.inverse_cosines for border in z)
    enter = np.maximum(rho[0][:, None] * rings.inverse_sines, np.minimum(z_low, z_high))
    leave = np.minimum(rho[1][:, None] * rings.inverse_sines, np.maximum(z_low, z_high))
    enter = np.maximum(enter, 0.0)
    on_edge = np.where(enter <= leave, enter, np.inf)
    bounds: Floats = np.minimum(on_edge[:, :-1], on_edge[:, 1:])
    return np.where(inside, direct, bounds)


def _plane_distance_bounds(distance: Floats, cosine: Floats, rings: ImageRings) -> Floats:
    """Distance within which each ring shows nothing that lies behind a plane.

    Args:
        distance: (n,) distances of the planes from the viewpoint; 0 for a viewpoint perhaps behind.
        cosine: (n,) cosines of the angle between the axis and the normals away from the viewpoint.

    Returns:
        (n, NUM_RINGS) metres.
    """
    # The point of a plane nearest along a ray at angle a from the normal is at d / cos a; a ring is
    # a range of such angles.
    tilt = arccos(np.clip(cosine, -1.0, 1.0))[:, None]
    edges = rings.edges_rad
    angle = np.maximum(
        np.maximum(edges[:-1] - tilt, tilt - edges[1:]) - (rings.padding_rad + _RELATIVE_PADDING),
        0.0,
    )
    facing = cos(angle)
    bounds = np.where(facing > 0.0, distance[:, None] / np.maximum(facing, _MIN_DIVISOR), np.inf)
    return np.where(distance[:, None] > 0.0, (1.0 - _RELATIVE_PADDING) * bounds, 0.0)


# A box that cannot lower the bound below this fraction is not refined.
_REFINE_FRACTION = 0.95
# Nor is one of a diagonal below this fraction of its distance: its nearest triangle is farther by
# that at most, and a twentieth of a radian beside the ring.
_REFINE_SIZE = 0.05
# Boxes refined a ring and step: enough for NumPy's overhead to vanish, few enough for the next step
# to profit from the bounds found.
_BATCH_SIZE = 8


@dataclass(frozen=True, slots=True, eq=False)
class ViewpointBox:
    """Box of viewpoints that share a mirror axis, in the triangles' frame."""

    centre: Floats
    """(3,) metres."""
    half_extent: Floats
    """(3,) metres; zero for a single viewpoint."""
    axis_rotation: Floats
    """(3, 3) to axes whose z is the mirror axis."""


def bound_ring_distances(
    triangles: TriangleHierarchy,
    viewpoints: ViewpointBox,
    rings: ImageRings,
    *,
    cutoff: Floats | None = None,
) -> Floats:
    """Distance within which no ring shows a triangle.

    Args:
        triangles: Triangles in view.
        viewpoints: Viewpoints for which the result must hold.
        rings: Rings of the image.
        cutoff: (NUM_RINGS,) distances; boxes beyond are not refined.

    Returns:
        (NUM_RINGS,) metres; inf for a ring without triangles.
    """
    cutoff = np.full(NUM_RINGS, np.inf) if cutoff is None else cutoff
    found = np.full(NUM_RINGS, np.inf)
    level = len(triangles.levels) - 1
    boxes = np.arange(triangles.levels[level].shape[1])
    pending = [(level, boxes, *_bound_boxes(triangles.levels[level], viewpoints, rings))]
    while pending:
        level, boxes, bounds, is_large = pending.pop()
        limit = np.where(found < cutoff, _REFINE_FRACTION * found, cutoff)
        is_needed = (bounds < limit).any(axis=1) & is_large
        # Boxes that are not refined count with their own bound.
        found = np.minimum(found, bounds[~is_needed].min(axis=0, initial=np.inf))
        if not is_needed.any():
            continue
        boxes, bounds = boxes[is_needed], bounds[is_needed]
        is_nearest = _are_nearest(bounds, limit)
        if not is_nearest.all():
            others = boxes[~is_nearest]
            pending.append((level, others, bounds[~is_nearest], np.ones(len(others), dtype=bool)))
        if level > 0:
            _, parts = triangles.children(level, boxes[is_nearest])
            of_parts = triangles.levels[level - 1].take(parts, axis=1)
            pending.append((level - 1, parts, *_bound_boxes(of_parts, viewpoints, rings)))
            continue
        corners = triangles.corners[triangles.rows(boxes[is_nearest]).ravel()]
        found = np.minimum(found, _bound_triangles(corners, viewpoints, rings).min(axis=0))
    return found


def _are_nearest(bounds: Floats, limit: Floats) -> Bools:
    """(n,) boxes that are among the nearest in any ring, of (n, NUM_RINGS) bounds below limits."""
    is_nearest = np.full(len(bounds), len(bounds) <= _BATCH_SIZE)
    # A partial sort by ring: the union over the rings is at most NUM_RINGS * _BATCH_SIZE boxes.
    if len(bounds) > _BATCH_SIZE:
        of_open = np.where(bounds < limit, bounds, np.inf)
        is_nearest[np.argpartition(of_open, _BATCH_SIZE, axis=0)[:_BATCH_SIZE]] = True
    return is_nearest


def _bound_boxes(
    boxes: Floats, viewpoints: ViewpointBox, rings: ImageRings
) -> tuple[Floats, Bools]:
    """(m, NUM_RINGS) bounds of (7, m) boxes, and whether each looks large."""
    low, high = boxes[:3].T, -boxes[3:6].T
    centre = matmul(0.5 * (low + high) - viewpoints.centre, viewpoints.axis_rotation.T)
    half = matmul(0.5 * (high - low) + viewpoints.half_extent, np.abs(viewpoints.axis_rotation).T)
    bounds = box_distance_bounds(centre - half, centre + half, rings)
    diagonal = np.linalg.norm(high - low, axis=-1)
    return bounds, diagonal > _REFINE_SIZE * bounds.min(axis=1)


def _bound_triangles(corners: Floats, viewpoints: ViewpointBox, rings: ImageRings) -> Floats:
    """(m, NUM_RINGS) bounds of (m, 3, 3) triangles."""
    normals, _ = facet_normals(corners)
    corners = corners - viewpoints.centre
    rotated = matmul(corners, viewpoints.axis_rotation.T)
    half = matmul(np.abs(viewpoints.axis_rotation), viewpoints.half_extent)
    to_box = box_distance_bounds(rotated.min(axis=1) - half, rotated.max(axis=1) + half, rings)
    along = (matmul(corners, normals[:, :, None]))[..., 0]
    in_front, behind = along.min(axis=1), -along.max(axis=1)
    distance = np.maximum(
        np.maximum(in_front, behind) - matmul(np.abs(normals), viewpoints.half_extent), 0.0
    )
    # All corners lie on one side of a plane, and so does the triangle: this holds for any normal,
    # so a degenerate triangle's does no harm.
    cosine = (matmul(normals, viewpoints.axis_rotation[2])) * np.where(
        in_front >= behind, 1.0, -1.0
    )
    return np.maximum(to_box, _plane_distance_bounds(distance, cosine, rings))
