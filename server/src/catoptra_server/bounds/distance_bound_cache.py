"""How near the scene is by ring of the image, found once for all viewpoints of a small box.

Boxes are cells of fixed grids, whatever was drawn before: a picture depends on its exposure alone.
The largest cell counts that takes little of what its middle has in sight. Cells are lower than
wide, for robots drive on floors: over an open one half a metre is not too much.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds import round_outward
from catoptra_server.bounds.image_rings import image_rings
from catoptra_server.bounds.ring_distance_bvh import RingDistanceBvh, ViewpointBox
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.twist import Vector3

# Largest first. Where even the least is too large, each viewpoint is asked for itself: smaller
# boxes would be left from frame to frame.
_CELL_SIDES_M = (0.5, 0.25, 0.125, 0.0625)
_CELL_HEIGHT_FRACTION = 0.125  # of the side
# What a box of viewpoints may take of what its middle has in sight.
_MIN_BOUND_FRACTION = 0.7
# Rings that show nothing nearer than so many times what is nearest may take any.
_FAR_RATIO = 4.0
# If more triangles than this have to be asked a box is too large.
_MAX_TRIANGLES = 2048
# Axes are told to so many digits: within 1e-6 rad, a tenth of what boxes are padded by.
_AXIS_DIGITS = 6
# 100 bytes each: a robot that drives needs five new ones a second.
_CACHE_SIZE = 4096

RingDistances = tuple[float, ...]


class DistanceBoundCache:
    """A scene, as the viewpoints in it are surrounded by it."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._cached_in_cell = lru_cache(maxsize=_CACHE_SIZE)(self._bounds_in_cell)
        self._cached_at_point = lru_cache(maxsize=_CACHE_SIZE)(self._bounds_at_point)

    @cached_property
    def _bvh(self) -> RingDistanceBvh:
        """Return the tree of boxes: a second's work for a million triangles, if asked for."""
        return RingDistanceBvh(self._scene.corners, self._scene.normals)

    @property
    def num_evaluations(self) -> int:
        """Return for how many viewpoints, and boxes of them, an answer was looked for so far."""
        return self._cached_in_cell.cache_info().misses + self._cached_at_point.cache_info().misses

    def min_distances_m(self, world_from_mirror: Pose, camera: OmniCamera) -> RingDistances:
        """Return the RINGS distances of a summary, rounded down."""
        axis = mirror_axis(world_from_mirror)
        x, y, z = world_from_mirror.translation.tolist()
        for side in _CELL_SIDES_M:
            cell = (round(x / side), round(y / side), round(z / (_CELL_HEIGHT_FRACTION * side)))
            nearest = self._cached_in_cell(camera, axis, cell, side)
            if nearest is not None:
                return nearest
        return self._cached_at_point(camera, axis, (x, y, z))

    def _bounds_at_point(self, camera: OmniCamera, axis: Vector3, point: Vector3) -> RingDistances:
        seen = ViewpointBox(np.array(point), np.zeros(3), rotation_to_axis(axis))
        return round_outward.round_down(self._bvh.bounds(seen, image_rings(camera)).tolist())

    def _bounds_in_cell(
        self, camera: OmniCamera, axis: Vector3, cell: tuple[int, int, int], side: float
    ) -> RingDistances | None:
        """Return the distances of a cell, None if it is too large for them."""
        rings, turn = image_rings(camera), rotation_to_axis(axis)
        sides = side * np.array((1.0, 1.0, _CELL_HEIGHT_FRACTION))
        middle = sides * cell
        at_middle = self._bvh.bounds(ViewpointBox(middle, np.zeros(3), turn), rings)
        if at_middle.min() < side:
            return None
        enough = _MIN_BOUND_FRACTION * at_middle
        box = ViewpointBox(middle, 0.5 * sides, turn)
        nearest = self._bvh.bounds(box, rings, cutoff=enough, max_triangles=_MAX_TRIANGLES)
        is_far = nearest >= _FAR_RATIO * nearest.min()
        is_fine = ((nearest >= enough) | is_far).all() and nearest.min() > 0.0
        return round_outward.round_down(nearest.tolist()) if is_fine else None


def mirror_axis(world_from_mirror: Pose) -> Vector3:
    """Return the mirror's axis in the world, rounded: robots that stand upright have the same."""
    x, y, z = world_from_mirror.rotation[:, 2].tolist()
    # Adding 0 makes one zero of the two.
    return round(x, _AXIS_DIGITS) + 0.0, round(y, _AXIS_DIGITS) + 0.0, round(z, _AXIS_DIGITS) + 0.0


@lru_cache(maxsize=64)
def rotation_to_axis(axis: Vector3) -> Floats:
    """Return the (3, 3) rotation to axes whose z is an axis, turned as little as may be.

    So boxes along the world's axes stay what they are where the mirror's axis is upright.
    """
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    if z < 0.0:
        return np.array([1.0, -1.0, -1.0])[:, None] * _rotation_to_upward_axis(-x, -y, -z)
    return _rotation_to_upward_axis(x, y, z)


def _rotation_to_upward_axis(x: float, y: float, z: float) -> Floats:
    """Return the rotation about (y, -x, 0) that leads (x, y, z) to (0, 0, 1); z >= 0."""
    c = 1.0 / (1.0 + z)
    return np.array(
        [[1.0 - c * x * x, -c * x * y, -x], [-c * x * y, 1.0 - c * y * y, -y], [x, y, z]]
    )
