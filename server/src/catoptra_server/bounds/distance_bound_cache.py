"""Distance bounds of the static scene, by ring of the image, shared by all viewpoints of a cell.

Cells belong to fixed grids and do not depend on earlier frames: a frame follows from its camera
state alone. Of four sizes the largest cell counts whose bound is little below that of its centre.
Cells are lower than wide, since robots drive on floors: above an open floor, half a metre up or
down would change the bound by far more than half a metre sideways.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds import round_outward
from catoptra_server.bounds.image_rings import image_rings
from catoptra_server.bounds.ring_distance_bvh import RingDistanceBvh, ViewpointBox
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Vector3

# Largest first. A viewpoint too near a surface for the smallest is evaluated on its own: a robot
# would leave smaller cells in every frame.
_CELL_SIDES_M = (0.5, 0.25, 0.125, 0.0625)
_CELL_HEIGHT_FRACTION = 0.125  # of the side
# A cell's bound may be this fraction of its centre's.
_MIN_BOUND_FRACTION = 0.7
# A ring this many times farther than the nearest may lose any fraction: the nearest ring dominates
# the criteria.
_FAR_RATIO = 4.0
# A cell whose query opens more triangles than this counts as too large.
_MAX_TRIANGLES = 2048
# Within 1e-6 rad, a tenth of the padding of boxes.
_AXIS_DIGITS = 6
# 100 bytes an entry; a driving robot needs five new ones a second.
_CACHE_SIZE = 4096

RingDistances = tuple[float, ...]


class DistanceBoundCache:
    """Distance bounds of one scene."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        # Caches of bound methods, per instance: a cache on the class would keep scenes alive.
        self._cached_in_cell = lru_cache(maxsize=_CACHE_SIZE)(self._bounds_in_cell)
        self._cached_at_point = lru_cache(maxsize=_CACHE_SIZE)(self._bounds_at_point)

    @cached_property
    def _bvh(self) -> RingDistanceBvh:
        """Bounding volume hierarchy: 0.35 s of work for a million triangles, so built on
        demand."""
        return RingDistanceBvh(self._scene.corners, self._scene.normals)

    @property
    def num_evaluations(self) -> int:
        """Number of viewpoints and cells evaluated so far, for tests and measurements."""
        return self._cached_in_cell.cache_info().misses + self._cached_at_point.cache_info().misses

    def min_distances_m(self, world_from_mirror: Pose, camera: RadialCamera) -> RingDistances:
        """Distance bound of each ring of the image, rounded down.

        Args:
            world_from_mirror: Pose of the mirror frame; its origin is the viewpoint.
        """
        axis = mirror_axis(world_from_mirror)
        x, y, z = world_from_mirror.translation.tolist()
        for side in _CELL_SIDES_M:
            cell = (round(x / side), round(y / side), round(z / (_CELL_HEIGHT_FRACTION * side)))
            nearest = self._cached_in_cell(camera, axis, cell, side)
            if nearest is not None:
                return nearest
        return self._cached_at_point(camera, axis, (x, y, z))

    def _bounds_at_point(
        self, camera: RadialCamera, axis: Vector3, point: Vector3
    ) -> RingDistances:
        viewpoint = ViewpointBox(np.array(point), np.zeros(3), rotation_to_axis(axis))
        return round_outward.round_down(self._bvh.bounds(viewpoint, image_rings(camera)).tolist())

    def _bounds_in_cell(
        self, camera: RadialCamera, axis: Vector3, cell: tuple[int, int, int], side: float
    ) -> RingDistances | None:
        """Bounds of a cell; None for a cell too large for its surroundings."""
        rings, rotation = image_rings(camera), rotation_to_axis(axis)
        sides = side * np.array((1.0, 1.0, _CELL_HEIGHT_FRACTION))
        centre = sides * cell
        at_centre = self._bvh.bounds(ViewpointBox(centre, np.zeros(3), rotation), rings)
        # A surface nearer than a cell's side: some viewpoint of the cell could touch the surface.
        if at_centre.min() < side:
            return None
        cutoff = _MIN_BOUND_FRACTION * at_centre
        box = ViewpointBox(centre, 0.5 * sides, rotation)
        nearest = self._bvh.bounds(box, rings, cutoff=cutoff, max_triangles=_MAX_TRIANGLES)
        is_far = nearest >= _FAR_RATIO * nearest.min()
        is_fine = ((nearest >= cutoff) | is_far).all() and nearest.min() > 0.0
        return round_outward.round_down(nearest.tolist()) if is_fine else None


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
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
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
