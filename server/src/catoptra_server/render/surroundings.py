"""How near the scene is by ring of the image, found once for all viewpoints of a small box.

Boxes are cells of fixed grids, whatever was drawn before: a picture depends on its exposure alone.
The largest cell counts that takes little of what its middle has in sight. Cells are lower than
wide, for robots drive on floors: over an open one half a metre is not too much.
"""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render import coarse
from catoptra_server.render.nearness import Nearness, Viewpoints
from catoptra_server.render.rings import rings_of
from catoptra_server.scene.meshes import SceneMesh
from catoptra_server.scene.motion import Vector

# Largest first. Where even the least is too large, each viewpoint is asked for itself: smaller
# boxes would be left from frame to frame.
_SIDES_M = (0.5, 0.25, 0.125, 0.0625)
_HEIGHT = 0.125  # of the side
# What a box of viewpoints may take of what its middle has in sight.
_KEEPS = 0.7
# Rings that show nothing nearer than so many times what is nearest may take any.
_FAR = 4.0
# If more triangles than this have to be asked a box is too large.
_MOST = 2048
# Axes are told to so many digits: within 1e-6 rad, a tenth of what boxes are padded by.
_DIGITS = 6
# 100 bytes each: a robot that drives needs five new ones a second.
_KEPT = 4096

Distances = tuple[float, ...]


class Surroundings:
    """A scene, as the viewpoints in it are surrounded by it."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._in_cell = lru_cache(maxsize=_KEPT)(self._nearest_in)
        self._at_point = lru_cache(maxsize=_KEPT)(self._nearest_at)

    @cached_property
    def _nearness(self) -> Nearness:
        """Return the tree of boxes: a second's work for a million triangles, if asked for."""
        return Nearness(self._scene.corners, self._scene.normals)

    @property
    def questions_asked(self) -> int:
        """Return for how many viewpoints, and boxes of them, an answer was looked for so far."""
        return self._in_cell.cache_info().misses + self._at_point.cache_info().misses

    def nearest_m(self, world_from_mirror: Pose, camera: OmniCamera) -> Distances:
        """Return the RINGS distances of a summary, rounded down."""
        axis = axis_of(world_from_mirror)
        x, y, z = world_from_mirror.translation.tolist()
        for side in _SIDES_M:
            cell = (round(x / side), round(y / side), round(z / (_HEIGHT * side)))
            nearest = self._in_cell(camera, axis, cell, side)
            if nearest is not None:
                return nearest
        return self._at_point(camera, axis, (x, y, z))

    def _nearest_at(self, camera: OmniCamera, axis: Vector, point: Vector) -> Distances:
        seen = Viewpoints(np.array(point), np.zeros(3), turn_to(axis))
        return coarse.down(self._nearness.bounds(seen, rings_of(camera)).tolist())

    def _nearest_in(
        self, camera: OmniCamera, axis: Vector, cell: tuple[int, int, int], side: float
    ) -> Distances | None:
        """Return the distances of a cell, None if it is too large for them."""
        rings, turn = rings_of(camera), turn_to(axis)
        sides = side * np.array((1.0, 1.0, _HEIGHT))
        middle = sides * cell
        at_middle = self._nearness.bounds(Viewpoints(middle, np.zeros(3), turn), rings)
        if at_middle.min() < side:
            return None
        enough = _KEEPS * at_middle
        box = Viewpoints(middle, 0.5 * sides, turn)
        nearest = self._nearness.bounds(box, rings, enough=enough, most=_MOST)
        is_far = nearest >= _FAR * nearest.min()
        is_fine = ((nearest >= enough) | is_far).all() and nearest.min() > 0.0
        return coarse.down(nearest.tolist()) if is_fine else None


def axis_of(world_from_mirror: Pose) -> Vector:
    """Return the mirror's axis in the world, rounded: robots that stand upright have the same."""
    x, y, z = world_from_mirror.rotation[:, 2].tolist()
    # Adding 0 makes one zero of the two.
    return round(x, _DIGITS) + 0.0, round(y, _DIGITS) + 0.0, round(z, _DIGITS) + 0.0


@lru_cache(maxsize=64)
def turn_to(axis: Vector) -> Floats:
    """Return the (3, 3) rotation to axes whose z is an axis, turned as little as may be.

    So boxes along the world's axes stay what they are where the mirror's axis is upright.
    """
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    if z < 0.0:
        return np.array([1.0, -1.0, -1.0])[:, None] * _turn_to(-x, -y, -z)
    return _turn_to(x, y, z)


def _turn_to(x: float, y: float, z: float) -> Floats:
    """Return the rotation about (y, -x, 0) that leads (x, y, z) to (0, 0, 1); z >= 0."""
    c = 1.0 / (1.0 + z)
    return np.array(
        [[1.0 - c * x * x, -c * x * y, -x], [-c * x * y, 1.0 - c * y * y, -y], [x, y, z]]
    )
