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

# Distance of a ray origin in front of the facet, relative to the largest coordinate: positions and
# corners are rounded to 2^-24 each, and a hit on a plane loses a few times that. 40 um at 10 m.
_RAY_BIAS = 2.0**-18


# From (n, 3) origins, (n, 3) directions and (n,) distances to (n,) whether a triangle lies between.
OcclusionQuery = Callable[[Float32s, Float32s, Float32s], Bools]


def make_occlusion_query(embree: EmbreeScene, scene: SceneMesh) -> OcclusionQuery:
    """Occlusion query over a scene's shadow casters; the scene itself if all triangles cast."""
    if scene.casts_shadows.all():
        return embree.occludes
    casters = rtcore_scene.EmbreeScene()
    corners = scene.corners[scene.casts_shadows] - embree.origin
    if not len(corners):
        return lambda origins, directions, distance: np.zeros(len(origins), dtype=bool)
    TriangleMesh(casters, corners.astype(np.float32))

    def occludes(origins: Float32s, directions: Float32s, distance: Float32s) -> Bools:
        occluder = casters.run(origins, directions, dists=distance, query="OCCLUDED")
        return np.asarray(occluder >= 0)

    # Embree builds its hierarchy at the first query: now, not in the first frame.
    occludes(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32), np.ones(1, np.float32))
    return occludes


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
        # Scaled by the largest coordinate of this batch: float32 rounding grows with the
        # coordinates.
        lift = _RAY_BIAS * np.abs(points).max(initial=0.0)
        positions: Floats = points + lift * normals + self._origin
        total: Floats = np.zeros_like(positions)
        for light in self._lights:
            unshadowed = shading.unshadowed_irradiance(light, positions, normals)
            # Only facets turned to the light, within its range, send a ray; all others are dark
            # anyway.
            facing = np.flatnonzero(unshadowed.any(axis=-1))
            if len(facing):
                lit = facing[~self._find_occlusion(light, positions.take(facing, axis=0), objects)]
                total[lit] += unshadowed[lit]
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
        origins = points + np.float32(_RAY_BIAS * np.abs(points).max(initial=0.0)) * normals
        visible = np.zeros(len(points), dtype=np.intp)
        for index, light in enumerate(self.directional_lights):
            facing = np.flatnonzero(facing_bits & (1 << index))
            is_occluded = self._find_directional_occlusion(
                light, origins.take(facing, axis=0), objects
            )
            visible[facing[~is_occluded]] |= 1 << index
        return visible

    def _find_directional_occlusion(
        self, light: DirectionalLight, origins: Float32s, objects: tuple[ObjectInstance, ...]
    ) -> Bools:
        """(n,) whether something lies between (n, 3) origins and a directional light."""
        to_light = -np.asarray(light.direction, dtype=np.float32)
        directions = np.broadcast_to(to_light, origins.shape)
        unlimited = np.full(len(origins), np.inf, dtype=np.float32)
        is_occluded = self._scene_occludes(origins, directions, unlimited)
        for instance in objects:
            # Rays that are occluded already are not tested again.
            remaining = np.flatnonzero(~is_occluded)
            positions = origins[remaining] + self._origin
            is_occluded[remaining] = instance.occludes(
                positions, directions[remaining], unlimited[remaining]
            )
        return is_occluded

    def _find_occlusion(
        self, light: ShadowCastingLight, points: Floats, objects: tuple[ObjectInstance, ...]
    ) -> Bools:
        """(n,) whether something lies between (n, 3) points, world frame, and a light."""
        to_light, light_distance = shading.direction_to_light(light, points)
        directions, distance = to_light.astype(np.float32), light_distance.astype(np.float32)
        origins = (points - self._origin).astype(np.float32)
        is_occluded = self._scene_occludes(origins, directions, distance)
        for instance in objects:
            remaining = np.flatnonzero(~is_occluded)
            is_occluded[remaining] = instance.occludes(
                points[remaining], directions[remaining], distance[remaining]
            )
        return is_occluded
