"""Environment of a robot's sensors: the scene through a ray caster, and other robots as boxes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import OrientedBox, box_distances, closest_box_hits
from catoptra_server.world.world_description import GpsOrigin, RfidTag, Victim

Triangles = npt.NDArray[np.int32]


class RayCaster(Protocol):
    """Distances in a static scene: Embree's in the server, exact ones of rooms in tests."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Distances (n,) to the first surface along unit (n, 3) directions; inf without one."""

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances, and unit normals (n, 3) of either side; inf and 0 without a surface."""

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        """Distances, and indices (n,) of the triangles; inf and -1 without a surface."""


class EmptyScene:
    """A scene without surfaces."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Infinite distances (n,)."""
        return np.full(len(directions), np.inf)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Infinite distances (n,) and normals (n, 3) of 0."""
        return self.distances(origins, directions), np.zeros(directions.shape)

    def closest_triangles(self, origins: Floats, directions: Floats) -> tuple[Floats, Triangles]:
        """Infinite distances (n,) and no triangles."""
        return self.distances(origins, directions), np.full(len(directions), -1, dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class SensorEnvironment:
    """Everything that the sensors of one robot measure, in the world frame."""

    scene: RayCaster
    robot_boxes: Sequence[OrientedBox] = ()
    """Bounding boxes of the other robots."""
    rfid_tags: Sequence[RfidTag] = ()
    victims: Sequence[Victim] = ()
    gps_origin: GpsOrigin | None = None
    """None for a world without geodetic coordinates."""

    def distances(self, origin: Floats, directions: Floats) -> Floats:
        """Distances (n,) to the first surface.

        Args:
            origin: (3,) for all rays, or (n, 3).
            directions: (n, 3) unit vectors.
        """
        origins = np.broadcast_to(origin, directions.shape)
        # Boxes are intersected directly: in the ray caster's scene each move would need a commit.
        # 0.6 ms a cycle of the P2AT among seven robots (tests/measurements/sensor_times.py).
        scene = self.scene.distances(origins, directions)
        return np.minimum(scene, box_distances(self.robot_boxes, origins, directions))

    def closest_hits(self, origin: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances, and normals (n, 3) of the first surfaces; arguments as of `distances`."""
        origins = np.broadcast_to(origin, directions.shape)
        scene, scene_normals = self.scene.closest_hits(origins, directions)
        boxes, box_normals = closest_box_hits(self.robot_boxes, origins, directions)
        is_box = (boxes < scene)[:, None]
        return np.minimum(scene, boxes), np.where(is_box, box_normals, scene_normals)


EMPTY_ENVIRONMENT = SensorEnvironment(EmptyScene())
