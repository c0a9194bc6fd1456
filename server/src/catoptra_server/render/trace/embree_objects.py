"""Dynamic objects in Embree: rays are transformed into each object's frame, no object is rebuilt.

Committing all objects in the world's frame and testing every ray takes 5.0 ms for one robot of 700
triangles, 11 ms for four and 29 ms for sixteen, per 100 000 rays; transforming the rays that pass
near an object takes 1.4, 4.3 and 11 ms, and all threads share the work:
tests/measurements/dynamic_objects.py. Only rays within the cone around an object are tested, and
only those that hit one are tested for occlusion by the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.packed_light import Float32s, Packed, RadianceScale
from catoptra_server.scene import shading
from catoptra_server.scene.dynamic_object import DynamicObject, ObjectMesh, world_facets
from catoptra_server.scene.world_description import Light

# Distance of a ray without an object hit: beyond every hit.
_NO_HIT = np.float32(1e30)
# Rays this much outside an object's cone are tested too: directions are float32.
_CONE_MARGIN = 1e-5
# Within this distance the sphere's cone is too wide: 65 degrees for a P2AT in its own mirror, whose
# corners lie within 47 degrees.
_NEAR_RADII = 2.0
# A corner this near to the viewpoint has no direction.
_MIN_DISTANCE_M = 1e-9

RayIndices = npt.NDArray[np.intp]


class EmbreeObjectScenes:
    """Embree scenes of object meshes, each committed at its first use."""

    def __init__(self, lights: tuple[Light, ...]) -> None:
        self._lights = lights
        self._scenes: dict[ObjectMesh, rtcore_scene.EmbreeScene] = {}

    def __len__(self) -> int:
        """Number of meshes committed so far."""
        return len(self._scenes)

    def with_lights(self, lights: tuple[Light, ...]) -> EmbreeObjectScenes:
        """The same committed meshes under other lights."""
        others = EmbreeObjectScenes(lights)
        others._scenes = self._scenes
        return others

    def place_objects(
        self, objects: tuple[DynamicObject, ...], viewpoint: Floats, scale: RadianceScale
    ) -> tuple[ObjectInstance, ...]:
        """Instances of objects at their poses, for rays from a (3,) viewpoint in the world."""
        return tuple(
            self._place_object(dynamic_object, viewpoint, scale) for dynamic_object in objects
        )

    def _place_object(
        self, dynamic_object: DynamicObject, viewpoint: Floats, scale: RadianceScale
    ) -> ObjectInstance:
        """Instance of one object, with its facets lit at the object's pose."""
        if dynamic_object.mesh not in self._scenes:
            self._scenes[dynamic_object.mesh] = _commit_mesh(dynamic_object.mesh)
        axis, cosine = _bounding_cone(dynamic_object, viewpoint)
        radiance = shading.facet_radiance(world_facets(dynamic_object), self._lights).T.astype(
            np.float32
        )
        return ObjectInstance(
            dynamic_object=dynamic_object,
            embree_scene=self._scenes[dynamic_object.mesh],
            viewpoint=dynamic_object.world_from_object.inverse().transform_points(viewpoint),
            cone_axis=axis.astype(np.float32),
            cone_cosine=cosine - _CONE_MARGIN,
            radiance=radiance,
            radiance_table=scale.pack(radiance),
            point_lights=shading.point_lights(self._lights),
        )


@dataclass(frozen=True, slots=True, eq=False)
class ObjectInstance:
    """A dynamic object in one frame."""

    dynamic_object: DynamicObject
    """Mesh and pose."""
    embree_scene: rtcore_scene.EmbreeScene
    """The mesh, committed in the object's frame."""
    viewpoint: Floats
    """(3,) viewpoint in the object's frame."""
    cone_axis: Float32s
    """(3,) unit axis of the cone around the object, world frame."""
    cone_cosine: float
    """Cosine of the cone's half angle; below -1 for all directions."""
    radiance: Float32s
    """(3, n) radiance of the triangles without point lights."""
    radiance_table: Packed
    """(n,) the same radiance, packed."""
    point_lights: tuple[Light, ...]
    """Point lights, shaded per hit."""

    def closest_hit(
        self, directions: Float32s, max_distance: Float32s
    ) -> tuple[RayIndices, Float32s, RayIndices]:
        """Hits of rays from the viewpoint, nearer than a limit of each ray.

        Args:
            directions: (n, 3) unit directions, world frame.
            max_distance: (n,) metres.

        Returns:
            Indices of the rays that hit, their distances, the triangles.
        """
        rays = np.flatnonzero(directions @ self.cone_axis >= self.cone_cosine)
        if not len(rays):
            return rays, np.zeros(0, np.float32), rays
        object_from_world = self.dynamic_object.world_from_object.rotation.astype(np.float32)
        # Rotating float32 directions into the object's frame keeps the committed mesh valid for
        # any pose; distances are the same in both frames.
        local_directions = directions.take(rays, axis=0) @ object_from_world
        origins = np.broadcast_to(self.viewpoint.astype(np.float32), local_directions.shape)
        hit = self.embree_scene.run(
            origins, local_directions, dists=max_distance.take(rays), output=True
        )
        hits = np.flatnonzero(hit["primID"] >= 0)
        return rays[hits], hit["tfar"][hits], hit["primID"][hits]

    def occludes(self, origins: Floats, directions: Float32s, max_distance: Float32s) -> Bools:
        """(n,) whether the object lies before each ray's `max_distance`; world frame."""
        pose, mesh = self.dynamic_object.world_from_object, self.dynamic_object.mesh
        from_centre = origins - self.dynamic_object.centre
        depth = np.einsum("ni,ni->n", from_centre, directions)
        squared_miss = np.einsum("ni,ni->n", from_centre, from_centre) - depth**2
        # No part of an object behind a ray's origin, or beside the ray, can be hit: the bounding
        # sphere rejects most rays before the transform into the object's frame.
        is_near = squared_miss <= mesh.radius_m**2 * (1.0 + _CONE_MARGIN) + _CONE_MARGIN
        rays = np.flatnonzero(is_near & (depth <= mesh.radius_m))
        is_occluded = np.zeros(len(origins), dtype=bool)
        if len(rays):
            local_origins = (
                pose.inverse().transform_points(origins.take(rays, axis=0)).astype(np.float32)
            )
            local_directions = directions.take(rays, axis=0) @ pose.rotation.astype(np.float32)
            limits = max_distance.take(rays)
            occluder = self.embree_scene.run(
                local_origins, local_directions, dists=limits, query="OCCLUDED"
            )
            is_occluded[rays] = occluder >= 0
        return is_occluded

    def shade(
        self, triangle: RayIndices, directions: Float32s, distance: Float32s, scale: RadianceScale
    ) -> Packed:
        """(n,) packed radiance of hits on triangles, at distances along directions."""
        if not self.point_lights:
            packed: Packed = self.radiance_table.take(triangle)
            return packed
        pose, mesh = self.dynamic_object.world_from_object, self.dynamic_object.mesh
        points = self._viewpoint_in_world(pose) + distance[:, None] * directions
        normals = pose.rotate_directions(mesh.normals[triangle])
        irradiance = shading.point_irradiance(self.point_lights, points, normals)
        irradiance[mesh.unlit[triangle]] = 0.0
        radiance = self.radiance[:, triangle] + (mesh.albedo[triangle] * irradiance).T
        return scale.pack(radiance.astype(np.float32))

    def _viewpoint_in_world(self, pose: Pose) -> Floats:
        """(3,) viewpoint in the world frame."""
        return pose.transform_points(self.viewpoint)


class ShadedObject(Protocol):
    """An object that rays can hit, and its shading."""

    def closest_hit(
        self, directions: Float32s, max_distance: Float32s
    ) -> tuple[RayIndices, Float32s, RayIndices]:
        """Hits nearer than a limit of each ray: indices of the rays, distances, triangles."""

    def shade(
        self, triangle: RayIndices, directions: Float32s, distance: Float32s, scale: RadianceScale
    ) -> Packed:
        """(n,) packed radiance of hits."""


def intersect_objects(
    objects: Sequence[ShadedObject], directions: Float32s, scale: RadianceScale
) -> tuple[RayIndices, Float32s, Packed]:
    """Closest object hit of each of (n, 3) rays.

    Returns:
        Indices of the rays that hit an object, their distances, packed radiance.
    """
    distance = np.full(len(directions), _NO_HIT)
    light = np.zeros(len(directions), dtype=np.uint64)
    # The limits shrink from object to object, so Embree itself rejects hits behind an earlier
    # object.
    for shaded_object in objects:
        rays, hit_distance, triangle = shaded_object.closest_hit(directions, distance)
        if len(rays):
            distance[rays] = hit_distance
            light[rays] = shaded_object.shade(triangle, directions[rays], hit_distance, scale)
    hits = np.flatnonzero(distance < _NO_HIT)
    return hits, distance[hits], light[hits]


def _bounding_cone(dynamic_object: DynamicObject, viewpoint: Floats) -> tuple[Floats, float]:
    """(3,) axis and cosine of a cone around an object; -2 stands for all directions.

    The cone of the bounding sphere; near the object, such as for a robot in its own mirror, the
    cone of the corners: a cone of less than a half-space is convex, so it contains every triangle
    between them.
    """
    to_centre = dynamic_object.centre - viewpoint
    distance, radius = float(np.linalg.norm(to_centre)), dynamic_object.mesh.radius_m
    if distance > _NEAR_RADII * radius:
        return to_centre / distance, math.sqrt(1.0 - (radius / distance) ** 2)
    all_directions: tuple[Floats, float] = np.zeros(3), -2.0
    if distance == 0.0:
        return all_directions
    axis = to_centre / distance
    rays = (
        dynamic_object.world_from_object.transform_points(dynamic_object.mesh.corners) - viewpoint
    ).reshape(-1, 3)
    cosine = float((rays @ axis / np.maximum(np.linalg.norm(rays, axis=-1), _MIN_DISTANCE_M)).min())
    return (axis, cosine) if cosine > 0.0 else all_directions


def _commit_mesh(mesh: ObjectMesh) -> rtcore_scene.EmbreeScene:
    """Embree scene of a mesh in the object's frame."""
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, mesh.corners.astype(np.float32))
    # Embree builds its hierarchy at the first query: now, not in the first frame.
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    return scene
