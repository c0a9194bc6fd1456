"""What range sensors see: the static scene through a ray caster, and other robots as boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.oriented_box import OrientedBox, box_distances, closest_box_hits
from catoptra_server.scene.world_description import GpsOrigin, RfidTag, Victim


class RayCaster(Protocol):
    """A static scene that can be measured. Tests bring exact ones, the server Embree's."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Return (n,) metres along unit (n, 3) directions from (n, 3) points; inf = nothing met."""

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return the distances, and (n, 3) unit normals, of either side; 0 where nothing is met."""


class EmptyScene:
    """A scene without anything in it."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Return (n,) infinite distances."""
        return np.full(len(directions), np.inf)

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return (n,) infinite distances and (n, 3) normals of 0."""
        return self.distances(origins, directions), np.zeros(directions.shape)


@dataclass(frozen=True, slots=True, eq=False)
class SensorEnvironment:
    """Everything around a robot that is not itself, in the world frame."""

    scene: RayCaster
    robot_boxes: Sequence[OrientedBox] = ()
    rfid_tags: Sequence[RfidTag] = ()
    victims: Sequence[Victim] = ()
    gps_origin: GpsOrigin | None = None

    def distances(self, origin: Floats, directions: Floats) -> Floats:
        """Return (n,) metres to the first thing along (n, 3) directions from (3,) or (n, 3)."""
        origins = np.broadcast_to(origin, directions.shape)
        scene = self.scene.distances(origins, directions)
        return np.minimum(scene, box_distances(self.robot_boxes, origins, directions))

    def closest_hits(self, origin: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return the distances, and the (n, 3) normals of what is met, of either side."""
        origins = np.broadcast_to(origin, directions.shape)
        scene, scene_normals = self.scene.closest_hits(origins, directions)
        bodies, body_normals = closest_box_hits(self.robot_boxes, origins, directions)
        is_body = (bodies < scene)[:, None]
        return np.minimum(scene, bodies), np.where(is_body, body_normals, scene_normals)


EMPTY_ENVIRONMENT = SensorEnvironment(EmptyScene())
