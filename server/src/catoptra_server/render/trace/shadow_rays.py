"""Rays to the lights: what stands before a light takes its irradiance from a place.

A ray begins a little in front of its facet, so that the facet itself, where rounding puts the place
behind it, does not hide the light. Facets turned away from a light ask nothing: they are dark.
Float64 twin: the functions of `scene/shading`, with every triangle tried.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.trace.embree_objects import ObjectInstance
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.scene import shading
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import ShadowCastingLight
from catoptra_server.scene.world_description import DirectionalLight, Light

# How far in front of a facet rays begin, of the largest coordinate: places and corners are rounded
# to 2^-24 each, and meeting a plane loses a few times that. 40 micrometres at 10 m.
_RAY_BIAS = 2.0**-18


# Whether something is met before rays' (n,) distances, of their (n, 3) origins and directions.
OcclusionQuery = Callable[[Float32s, Float32s, Float32s], Bools]


def make_occlusion_query(embree: EmbreeScene, scene: SceneMesh) -> OcclusionQuery:
    """Return what asks those triangles of a scene that hide lights: the scene itself if all do."""
    if scene.casts_shadows.all():
        return embree.occludes
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

    def __init__(
        self, scene_occludes: OcclusionQuery, origin: Floats, lights: tuple[Light, ...]
    ) -> None:
        self._scene_occludes = scene_occludes
        self._origin = origin
        self._lights = shading.shadow_casting_lights(lights)
        self.directional_lights = [
            light for light in self._lights if isinstance(light, DirectionalLight)
        ]

    def irradiance(
        self, points: Floats, normals: Floats, objects: tuple[ObjectInstance, ...]
    ) -> Floats:
        """Return (n, 3) irradiance by all lights that can be hidden, where they are not.

        points: (n, 3) in Embree's coordinates, on facets of (n, 3) unit normals.
        """
        lift = _RAY_BIAS * np.abs(points).max(initial=0.0)
        places: Floats = points + lift * normals + self._origin
        total: Floats = np.zeros_like(places)
        for light in self._lights:
            unhidden = shading.unshadowed_irradiance(light, places, normals)
            asking = np.flatnonzero(unhidden.any(axis=-1))
            if len(asking):
                seen = asking[~self._find_occlusion(light, places.take(asking, axis=0), objects)]
                total[seen] += unhidden[seen]
        return total

    def visible_directional_lights(
        self,
        points: Float32s,
        normals: Float32s,
        facing_bits: npt.NDArray[np.uint8],
        objects: tuple[ObjectInstance, ...],
    ) -> npt.NDArray[np.intp]:
        """Return (n,) which lights with a direction are seen from places, a bit each.

        points, normals: as for `irradiance`. faced: (n,) those that facets are turned to, bits.
        """
        lifted = points + np.float32(_RAY_BIAS * np.abs(points).max(initial=0.0)) * normals
        seen = np.zeros(len(points), dtype=np.intp)
        for index, sun in enumerate(self.directional_lights):
            asking = np.flatnonzero(facing_bits & (1 << index))
            hidden = self._find_directional_occlusion(sun, lifted.take(asking, axis=0), objects)
            seen[asking[~hidden]] |= 1 << index
        return seen

    def _find_directional_occlusion(
        self, light: DirectionalLight, origins: Float32s, objects: tuple[ObjectInstance, ...]
    ) -> Bools:
        """Return (n,) whether something stands between (n, 3) origins and a light."""
        towards = -np.asarray(light.direction, dtype=np.float32)
        directions = np.broadcast_to(towards, origins.shape)
        far = np.full(len(origins), np.inf, dtype=np.float32)
        hidden = self._scene_occludes(origins, directions, far)
        for body in objects:
            left = np.flatnonzero(~hidden)
            places = origins[left] + self._origin
            hidden[left] = body.occludes(places, directions[left], far[left])
        return hidden

    def _find_occlusion(
        self, light: ShadowCastingLight, points: Floats, objects: tuple[ObjectInstance, ...]
    ) -> Bools:
        """Return (n,) whether something stands between (n, 3) places and a light; world frame."""
        towards, far = shading.direction_to_light(light, points)
        directions, distance = towards.astype(np.float32), far.astype(np.float32)
        origins = (points - self._origin).astype(np.float32)
        hidden = self._scene_occludes(origins, directions, distance)
        for body in objects:
            left = np.flatnonzero(~hidden)
            hidden[left] = body.occludes(points[left], directions[left], distance[left])
        return hidden
