"""What range sensors see: the static scene through a ray caster, and other robots as boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.description import GpsOrigin, RfidTag, Victim
from catoptra_server.scene.oriented_box import OrientedBox, box_distances


class RayCaster(Protocol):
    """A static scene that can be measured. Tests bring exact ones, the server Embree's."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Return (n,) metres along unit (n, 3) directions from (n, 3) points; inf = nothing met."""


class Nothing:
    """A scene without anything in it."""

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """Return (n,) infinite distances."""
        return np.full(len(directions), np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Everything around a robot that is not itself, in the world frame."""

    scene: RayCaster
    bodies: Sequence[OrientedBox] = ()
    tags: Sequence[RfidTag] = ()
    victims: Sequence[Victim] = ()
    gps_origin: GpsOrigin | None = None

    def distances(self, origin: Floats, directions: Floats) -> Floats:
        """Return (n,) metres to the first thing along (n, 3) directions from (3,) or (n, 3)."""
        origins = np.broadcast_to(origin, directions.shape)
        scene = self.scene.distances(origins, directions)
        return np.minimum(scene, box_distances(self.bodies, origins, directions))


EMPTY = Surroundings(Nothing())
