"""Scenes with exact geometry for range sensors: a room of six walls, and sensor contexts in it."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation.sensors import SensorContext, SensorEnvironment, Triangles
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.world_description import Box, Item, Material, World


class RoomRayCaster:
    """Rays in a room around the origin with these half edges, computed analytically in float64."""

    def __init__(self, half_m: tuple[float, float, float] = (4.0, 3.0, 2.0)) -> None:
        self._half = np.array(half_m)

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Distances (n,) to the walls, metres."""
        parallel = np.abs(directions) < 1e-12
        along = np.where(parallel, 1.0, directions)
        wall_distances = (np.copysign(self._half, along) - origins) / along
        return np.where(parallel, np.inf, wall_distances).min(axis=-1)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances (n,), and inward normals (n, 3) of the walls."""
        distances = self.distances(origins, directions)
        points = (origins + distances[:, None] * directions) / self._half
        wall = np.abs(points).argmax(axis=1)
        normals = -np.sign(np.take_along_axis(points, wall[:, None], axis=1)) * np.eye(3)[wall]
        return distances, normals

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        """Distances (n,), and no triangles: the walls are planes."""
        return self.distances(origins, directions), np.full(len(directions), -1, dtype=np.int32)


def make_room_world(half_m: tuple[float, float, float] = (4.0, 3.0, 2.0)) -> World:
    """The same room as a world, with walls 0.1 m thick."""
    items = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            centre, size = [0.0, 0.0, 0.0], [2.0 * (half + 0.1) for half in half_m]
            centre[axis], size[axis] = side * (half_m[axis] + 0.05), 0.1
            shape = Box((size[0], size[1], size[2]))
            items.append(
                Item(
                    f"wall {axis} {side:g}", shape, Pose.from_rpy(centre), Material((0.5, 0.5, 0.5))
                )
            )
    return World("room", tuple(items))


def oriented_box_at(
    x_m: float, y_m: float, *, size_m: tuple[float, float, float] = (0.4, 0.4, 0.4)
) -> OrientedBox:
    """An upright box with its centre at height 0."""
    return OrientedBox(Pose.from_rpy((x_m, y_m, 0.0)), size_m)


def context_in_room(*boxes: OrientedBox, pose: Pose | None = None, tick: int = 0) -> SensorContext:
    """Sensor context of a robot in the room, with other robots as boxes."""
    return SensorContext(
        1.0, tick, pose or Pose.identity(), SensorEnvironment(RoomRayCaster(), boxes)
    )
