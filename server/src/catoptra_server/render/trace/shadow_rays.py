"""Shadow rays: occlusion of lights at points on surfaces.

A ray begins a little in front of its facet, so that the facet itself, behind which rounding may put
the point, does not occlude the light. Facets turned away from a light send no ray: they are dark.
Float64 twin: the functions of `scene/shading`, with every triangle tested.
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
    """Occlusion query over a scene's shadow casters; the scene itself if all triangles cast."""
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
    """The shadow-casting lights of a world, and the scene that occludes them."""

    def __init__(
        self, scene_occludes: OcclusionQuery, origin: Floats, lights: tuple[Light, ...]
    ) -> None:
        """Keep the lights and the query.

        Args:
            scene_occludes: Occlusion query over the static scene.
            origin: (3,) origin of Embree's coordinates in the world.
            lights: All lights of the world.
        """
        self._scene_occludes = scene_occludes
        self._origin = origin
        self._lights = shading.shadow_casting_lights(lights)
        self.directional_lights = [
            light for light in self._lights if isinstance(light, DirectionalLight)
        ]

    def irradiance(
        self, points: Floats, normals: Floats, objects: tuple[ObjectInstance, ...]
    ) -> Floats:
        """(n, 3) irradiance of all shadow-casting lights, zero where a light is occluded.

        Args:
            points: (n, 3) positions in Embree's coordinates.
            normals: (n, 3) unit normals of the facets.
            objects: Dynamic objects, which occlude lights too.
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
        """(n,) bit mask of the directional lights visible from each point.

        Args:
            points: (n, 3) positions in Embree's coordinates.
            normals: (n, 3) unit normals of the facets.
            facing_bits: (n,) bit mask of the lights that each facet is turned to.
            objects: Dynamic objects, which occlude lights too.
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
        """(n,) whether something lies between (n, 3) origins and a directional light."""
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
        """(n,) whether something lies between (n, 3) points, world frame, and a light."""
        towards, far = shading.direction_to_light(light, points)
        directions, distance = towards.astype(np.float32), far.astype(np.float32)
        origins = (points - self._origin).astype(np.float32)
        hidden = self._scene_occludes(origins, directions, distance)
        for body in objects:
            left = np.flatnonzero(~hidden)
            hidden[left] = body.occludes(points[left], directions[left], distance[left])
        return hidden
