"""How near the scene is by ring of the image, found once for all viewpoints of a small box.

Boxes are those of a fixed grid, whatever was drawn before: a picture depends on its exposure alone.
A box is as large as its answer allows: its side is a small share of what is nearest in sight, its
height a smaller one, for robots drive on floors.
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

# Largest first. A robot that touches a wall is not helped by less than a centimetre.
_SIDES_M = tuple(2.0**-power for power in range(1, 8))
_HEIGHT = 0.125  # of the side
# What a box of viewpoints may take of what its middle has in sight.
_KEEPS = 0.75
# Rings that show nothing nearer than so many times what is nearest may take any.
_FAR = 4.0
# If more triangles than this have to be asked a box is too large.
_MOST = 2048
# Axes are told to so many digits: within 1e-6 rad, a tenth of what boxes are padded by.
_DIGITS = 6
# 100 bytes each: a robot that drives needs five new ones a second.
_KEPT = 4096


class Surroundings:
    """A scene, as the viewpoints in it are surrounded by it."""

    def __init__(self, scene: SceneMesh) -> None:
        self._scene = scene
        self._in_cell = lru_cache(maxsize=_KEPT)(self._nearest_in)

    @cached_property
    def _nearness(self) -> Nearness:
        """Return the tree of boxes: a second's work for a million triangles, if asked for."""
        return Nearness(self._scene.corners, self._scene.normals)

    @property
    def cells_found(self) -> int:
        """Return for how many boxes of viewpoints an answer was looked for so far."""
        return self._in_cell.cache_info().misses

    def nearest_m(self, world_from_mirror: Pose, camera: OmniCamera) -> tuple[float, ...]:
        """Return the RINGS distances of a summary, rounded down."""
        axis = axis_of(world_from_mirror)
        x, y, z = world_from_mirror.translation.tolist()
        for side in _SIDES_M:
            cell = (round(x / side), round(y / side), round(z / (_HEIGHT * side)), side)
            nearest, is_fine = self._in_cell(camera, axis, cell)
            if is_fine:
                break
        return nearest

    def _nearest_in(
        self, camera: OmniCamera, axis: Vector, cell: tuple[int, int, int, float]
    ) -> tuple[tuple[float, ...], bool]:
        """Return the distances of a cell, and whether it is small enough for them."""
        rings, turn = rings_of(camera), turn_to(axis)
        sides = cell[3] * np.array((1.0, 1.0, _HEIGHT))
        point = Viewpoints(sides * cell[:3], np.zeros(3), turn)
        at_middle = self._nearness.bounds(point, rings)
        box = Viewpoints(point.middle, 0.5 * sides, turn)
        enough = _KEEPS * at_middle
        nearest = self._nearness.bounds(box, rings, enough=enough, most=_MOST)
        is_far = nearest >= _FAR * nearest.min()
        is_fine = bool(((nearest >= enough) | is_far).all() and nearest.min() > 0.0)
        return coarse.down(nearest.tolist()), is_fine


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
