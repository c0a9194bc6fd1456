"""Rays to the lights: what stands before a light takes its irradiance from a place.

A ray begins a little in front of its facet, so that the facet itself, where rounding puts the place
behind it, does not hide the light. Facets turned away from a light ask nothing: they are dark.
Float64 twin: the functions of `render/shading`, with every triangle tried.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render import shading
from catoptra_server.render.shading import HideableLight
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.moving_bodies import PlacedBody
from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.scene.description import DirectionalLight, Light
from catoptra_server.scene.meshes import SceneMesh

# How far in front of a facet rays begin, of the largest coordinate: places and corners are rounded
# to 2^-24 each, and meeting a plane loses a few times that. 40 micrometres at 10 m.
_LIFT = 2.0**-18


# Whether something is met before rays' (n,) distances, of their (n, 3) origins and directions.
Hidden = Callable[[Float32s, Float32s, Float32s], Bools]


def casters(embree: EmbreeScene, scene: SceneMesh) -> Hidden:
    """Return what asks those triangles of a scene that hide lights: the scene itself if all do."""
    if scene.casts_shadows.all():
        return embree.hidden
    casting = rtcore_scene.EmbreeScene()
    corners = scene.corners[scene.casts_shadows] - embree.origin
    if not len(corners):
        return lambda origins, directions, distance: np.zeros(len(origins), dtype=bool)
    TriangleMesh(casting, corners.astype(np.float32))

    def hidden(origins: Float32s, directions: Float32s, distance: Float32s) -> Bools:
        answer = casting.run(origins, directions, dists=distance, query="OCCLUDED")
        return np.asarray(answer >= 0)

    hidden(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), np.ones(1, np.float32))
    return hidden


class ShadowRays:
    """The lights of a world that can be hidden, and the scene that hides them.

    origin: (3,), of Embree's coordinates. suns: those of the lights that have a direction.
    """

    def __init__(self, hidden: Hidden, origin: Floats, lights: tuple[Light, ...]) -> None:
        self._hidden_by_scene = hidden
        self._origin = origin
        self._lights = shading.hideable_lights(lights)
        self.suns = [light for light in self._lights if isinstance(light, DirectionalLight)]

    def irradiance(self, points: Floats, normals: Floats, bodies: tuple[PlacedBody, ...]) -> Floats:
        """Return (n, 3) irradiance by all lights that can be hidden, where they are not.

        points: (n, 3) in Embree's coordinates, on facets of (n, 3) unit normals.
        """
        lift = _LIFT * np.abs(points).max(initial=0.0)
        places: Floats = points + lift * normals + self._origin
        total: Floats = np.zeros_like(places)
        for light in self._lights:
            unhidden = shading.light_irradiance(light, places, normals)
            asking = np.flatnonzero(unhidden.any(axis=-1))
            if len(asking):
                seen = asking[~self._hidden(light, places.take(asking, axis=0), bodies)]
                total[seen] += unhidden[seen]
        return total

    def suns_seen(
        self,
        points: Float32s,
        normals: Float32s,
        faced: npt.NDArray[np.uint8],
        bodies: tuple[PlacedBody, ...],
    ) -> npt.NDArray[np.intp]:
        """Return (n,) which lights with a direction are seen from places, a bit each.

        points, normals: as for `irradiance`. faced: (n,) those that facets are turned to, bits.
        """
        lifted = points + np.float32(_LIFT * np.abs(points).max(initial=0.0)) * normals
        seen = np.zeros(len(points), dtype=np.intp)
        for index, sun in enumerate(self.suns):
            asking = np.flatnonzero(faced & (1 << index))
            hidden = self._hidden_from_sun(sun, lifted.take(asking, axis=0), bodies)
            seen[asking[~hidden]] |= 1 << index
        return seen

    def _hidden_from_sun(
        self, sun: DirectionalLight, origins: Float32s, bodies: tuple[PlacedBody, ...]
    ) -> Bools:
        """Return (n,) whether something stands between (n, 3) origins and a light."""
        towards = -np.asarray(sun.direction, dtype=np.float32)
        directions = np.broadcast_to(towards, origins.shape)
        far = np.full(len(origins), np.inf, dtype=np.float32)
        hidden = self._hidden_by_scene(origins, directions, far)
        for body in bodies:
            left = np.flatnonzero(~hidden)
            places = origins[left] + self._origin
            hidden[left] = body.hides(places, directions[left], far[left])
        return hidden

    def _hidden(
        self, light: HideableLight, places: Floats, bodies: tuple[PlacedBody, ...]
    ) -> Bools:
        """Return (n,) whether something stands between (n, 3) places and a light; world frame."""
        towards, far = shading.towards_light(light, places)
        directions, distance = towards.astype(np.float32), far.astype(np.float32)
        origins = (places - self._origin).astype(np.float32)
        hidden = self._hidden_by_scene(origins, directions, distance)
        for body in bodies:
            left = np.flatnonzero(~hidden)
            hidden[left] = body.hides(places[left], directions[left], distance[left])
        return hidden
