"""Distance bounds of the static scene: no ring of the image shows a surface that is nearer.

A ring is a band of angles theta about the optical axis, at any azimuth. So a box counts as the
solid of revolution that it sweeps about the axis: a rectangle of (rho, z). The rectangle's nearest
point within a band is its nearest point to the viewpoint, if in the band, or lies on one of the
band's two borders.

Triangles are bounded in a hierarchy of boxes: neighbours share a box, neighbouring boxes a larger
one. A query holds for all viewpoints of a box at once, so its result can be cached. A triangle is
bounded by its own box, rotated with the optical axis, and by its own plane. Occlusion is not
considered: a hidden triangle counts.

Of four sizes of cells the largest counts whose bound is little below its centre's. Cells are lower
than wide: above an open floor, half a metre up or down would change the bound by far more than half
a metre sideways.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from catoptra_protocol.optics.elementary import arccos, arctan, arctan2, cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import NUM_RINGS
from catoptra_server.effects.bounds.coordinate_rounding import POINT_M, ViewpointCells, round_down
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.triangles import Indices, make_clusters
from catoptra_server.world.world_description import Vector3

_CELL_SIDES_M = (0.5, 0.25, 0.125, 0.0625)
# A cell's bound may be this fraction of its centre's.
_MIN_BOUND_FRACTION = 0.7
# A ring this many times farther than the nearest may lose any fraction: the nearest ring dominates
# the criteria.
_FAR_RATIO = 4.0
# A cell whose query opens more triangles than this counts as too large.
_MAX_TRIANGLES_PER_CELL = 2048
# Within 1e-6 rad, a tenth of the padding of boxes.
_AXIS_DIGITS = 6
_RingDistances = tuple[float, ...]


class DistanceBoundCache:
    """Distance bounds of one scene."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._cells = ViewpointCells(_CELL_SIDES_M, self._bounds_in_cell)

    @cached_property
    def _bvh(self) -> RingDistanceBvh:
        # On demand: 0.35 s for a million triangles.
        return RingDistanceBvh(self._scene.corners, self._scene.normals)

    @property
    def num_evaluations(self) -> int:
        """Number of viewpoints and cells evaluated so far, for tests and measurements."""
        return self._cells.num_evaluations

    def min_distances_m(self, world_from_mirror: Pose, camera: RadialCamera) -> _RingDistances:
        """Distance bound of each ring of the image, rounded down.

        Args:
            world_from_mirror: Pose of the mirror frame; its origin is the viewpoint.
        """
        axis = mirror_axis(world_from_mirror)
        return self._cells.find(world_from_mirror.translation, camera, axis)

    def _bounds_in_cell(
        self, centre: Floats, sides: Floats, camera: RadialCamera, axis: Vector3
    ) -> _RingDistances | None:
        """Bounds of a cell; None for a cell too large for its surroundings."""
        rings, rotation = image_rings(camera), rotation_to_axis(axis)
        box = ViewpointBox(centre, 0.5 * sides, rotation)
        if sides[0] == POINT_M:
            return round_down(self._bvh.bounds(box, rings).tolist())
        at_centre = self._bvh.bounds(ViewpointBox(centre, np.zeros(3), rotation), rings)
        # A surface nearer than a cell's side: some viewpoint of the cell could touch the surface.
        if at_centre.min() < sides.max():
            return None
        cutoff = _MIN_BOUND_FRACTION * at_centre
        nearest = self._bvh.bounds(box, rings, cutoff=cutoff, max_triangles=_MAX_TRIANGLES_PER_CELL)
        is_far = nearest >= _FAR_RATIO * nearest.min()
        is_fine = ((nearest >= cutoff) | is_far).all() and nearest.min() > 0.0
        return round_down(nearest.tolist()) if is_fine else None


def mirror_axis(world_from_mirror: Pose) -> Vector3:
    """Mirror axis in the world, rounded, so that all upright robots share one."""
    x, y, z = world_from_mirror.rotation[:, 2].tolist()
    # -0.0 + 0.0 is 0.0: one cache key for both zeros.
    return round(x, _AXIS_DIGITS) + 0.0, round(y, _AXIS_DIGITS) + 0.0, round(z, _AXIS_DIGITS) + 0.0


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


@lru_cache(maxsize=16)
def image_rings(camera: RadialCamera) -> ImageRings:
    """Rings of a camera by its exact projection; a mesh may show a direction in the next ring."""
    radius_px = np.linspace(0.0, camera.rim_radius_px, NUM_RINGS + 1)
    t = camera.t_from_radius_px(radius_px)
    edges_rad = 2.0 * arctan(t)
    cosines = cos(edges_rad)
    return ImageRings(
        edges_rad,
        inverse_sines=1.0 / np.maximum(sin(edges_rad), _MIN_DIVISOR),
        inverse_cosines=1.0 / np.where(np.abs(cosines) < _MIN_DIVISOR, _MIN_DIVISOR, cosines),
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
    pad = _RELATIVE_PADDING * (rho_high + far[:, 2])
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
        np.maximum(edges[:-1] - tilt, tilt - edges[1:]) - 2.0 * _RELATIVE_PADDING, 0.0
    )
    facing = cos(angle)
    bounds = np.where(facing > 0.0, distance[:, None] / np.maximum(facing, _MIN_DIVISOR), np.inf)
    return np.where(distance[:, None] > 0.0, (1.0 - _RELATIVE_PADDING) * bounds, 0.0)


# Triangles a leaf, and boxes a parent.
_BRANCHING = 16
_MAX_ROOTS = 128
# A box that cannot lower the bound below this fraction is not refined.
_REFINE_FRACTION = 0.95
# Boxes refined a ring and step: enough for NumPy's overhead to vanish, few enough for the next step
# to profit from the bounds found.
_BATCH_SIZE = 8
# Some 5 ms.
_MAX_TRIANGLES = 2**14


@dataclass(frozen=True, slots=True, eq=False)
class ViewpointBox:
    """Box of viewpoints that share a mirror axis, in the triangles' frame."""

    centre: Floats
    """(3,) metres."""
    half_extent: Floats
    """(3,) metres; zero for a single viewpoint."""
    axis_rotation: Floats
    """(3, 3) to axes whose z is the mirror axis."""


class RingDistanceBvh:
    """Hierarchy over (n, 3, 3) corners and (n, 3) normals."""

    def __init__(self, corners: Floats, normals: Floats) -> None:
        clusters = make_clusters(corners, np.zeros(len(corners), dtype=np.intp), size=_BRANCHING)
        self._corners = corners
        self._normals = normals
        self._order = clusters.order
        low, high = clusters.box_min, clusters.box_max
        # Leaves first, roots last.
        self._levels: list[_Boxes] = []
        while len(low):
            self._levels.append(_Boxes(0.5 * (low + high), 0.5 * (high - low)))
            if len(low) <= _MAX_ROOTS:
                break
            first = np.arange(0, len(low), _BRANCHING)
            low, high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)

    def bounds(
        self,
        viewpoints: ViewpointBox,
        rings: ImageRings,
        *,
        cutoff: Floats | None = None,
        max_triangles: int = _MAX_TRIANGLES,
    ) -> Floats:
        """Distance within which no ring shows a triangle.

        Args:
            viewpoints: Viewpoints for which the result must hold.
            cutoff: (NUM_RINGS,) distances; boxes beyond are not refined.
            max_triangles: Number of triangles after which no box is refined; boxes then count as a
                whole, which is safe and loose.

        Returns:
            (NUM_RINGS,) metres; inf for a ring without triangles.
        """
        nearest = np.full(NUM_RINGS, np.inf) if cutoff is None else cutoff / _REFINE_FRACTION
        found = np.full(NUM_RINGS, np.inf)
        pending = []
        if self._levels:
            roots = np.arange(len(self._levels[-1].half_extent))
            pending.append(self._bound_nodes(len(self._levels) - 1, roots, viewpoints, rings))
        while pending:
            group = pending.pop()
            is_needed = np.asarray(
                (group.bounds < _REFINE_FRACTION * nearest).any(axis=1) & (max_triangles > 0)
            )
            # Boxes that are not refined count with their own bound.
            found = np.minimum(found, group.bounds[~is_needed].min(axis=0, initial=np.inf))
            if not is_needed.any():
                continue
            nearest_group, others = group.select(is_needed).split_nearest(
                _REFINE_FRACTION * nearest
            )
            if len(others.nodes):
                pending.append(others)
            if group.level > 0:
                level = group.level - 1
                children = _child_indices(nearest_group.nodes, len(self._levels[level].centre))
                pending.append(self._bound_nodes(level, children, viewpoints, rings))
                continue
            positions = _child_indices(nearest_group.nodes, len(self._order))
            found = np.minimum(
                found, self._triangle_bounds(positions, viewpoints, rings).min(axis=0)
            )
            nearest = np.minimum(nearest, found)
            max_triangles -= len(positions)
        return found

    def _bound_nodes(
        self, level: int, nodes: Indices, viewpoints: ViewpointBox, rings: ImageRings
    ) -> _NodeBounds:
        return _NodeBounds(level, nodes, self._levels[level].bounds(nodes, viewpoints, rings))

    def _triangle_bounds(
        self, positions: Indices, viewpoints: ViewpointBox, rings: ImageRings
    ) -> Floats:
        """(m, NUM_RINGS) bounds of the triangles at (m,) positions of the order."""
        triangles = self._order[positions]
        corners, normals = self._corners[triangles] - viewpoints.centre, self._normals[triangles]
        rotated = matmul(corners, viewpoints.axis_rotation.T)
        half = matmul(np.abs(viewpoints.axis_rotation), viewpoints.half_extent)
        to_box = box_distance_bounds(rotated.min(axis=1) - half, rotated.max(axis=1) + half, rings)
        along = matmul(corners, normals[:, :, None])[..., 0]
        in_front, behind = along.min(axis=1), -along.max(axis=1)
        distance = np.maximum(
            np.maximum(in_front, behind) - matmul(np.abs(normals), viewpoints.half_extent), 0.0
        )
        # All corners lie on one side of a plane, and so does the triangle: this holds for any
        # normal, so a degenerate triangle's does no harm.
        cosine = matmul(normals, viewpoints.axis_rotation[2]) * np.where(
            in_front >= behind, 1.0, -1.0
        )
        return np.maximum(to_box, _plane_distance_bounds(distance, cosine, rings))


@dataclass(frozen=True, slots=True, eq=False)
class _Boxes:
    """Boxes of one level, (n, 3) each."""

    centre: Floats
    half_extent: Floats

    def bounds(self, indices: Indices, viewpoints: ViewpointBox, rings: ImageRings) -> Floats:
        """(m, NUM_RINGS) bounds of the boxes at some indices."""
        centre = matmul(self.centre[indices] - viewpoints.centre, viewpoints.axis_rotation.T)
        half = matmul(
            self.half_extent[indices] + viewpoints.half_extent, np.abs(viewpoints.axis_rotation).T
        )
        return box_distance_bounds(centre - half, centre + half, rings)


@dataclass(frozen=True, slots=True, eq=False)
class _NodeBounds:
    """Boxes of one level with their bounds."""

    level: int
    nodes: Indices
    """(n,) indices within the level."""
    bounds: Floats
    """(n, NUM_RINGS) metres."""

    def select(self, mask: Bools) -> _NodeBounds:
        """Boxes of a (n,) mask."""
        return _NodeBounds(self.level, self.nodes[mask], self.bounds[mask])

    def split_nearest(self, cutoff: Floats) -> tuple[_NodeBounds, _NodeBounds]:
        """Boxes that are nearest in any ring and nearer than the (NUM_RINGS,) cutoff; and the
        rest."""
        is_nearest = np.ones(len(self.nodes), dtype=bool)
        # A partial sort by ring: the union over the rings is at most NUM_RINGS * _BATCH_SIZE boxes.
        if len(is_nearest) > _BATCH_SIZE:
            open_bounds = np.where(self.bounds < cutoff, self.bounds, np.inf)
            is_nearest[:] = False
            is_nearest[np.argpartition(open_bounds, _BATCH_SIZE, axis=0)[:_BATCH_SIZE]] = True
        return self.select(is_nearest), self.select(~is_nearest)


def _child_indices(nodes: Indices, count: int) -> Indices:
    """Indices of the children of nodes, in a level of `count` members."""
    children = (nodes[:, None] * _BRANCHING + np.arange(_BRANCHING)).ravel()
    return children[children < count]
