"""Bodies in Embree's hands: rays are turned into each body's frame, bodies are never rebuilt.

Committing all bodies in the world's frame and asking every ray takes 5.0 ms for one robot of 700
triangles, 11 ms for four and 29 ms for sixteen, per 100 000 rays; turning the rays that pass near
a body takes 1.4, 4.3 and 11 ms, and all threads share it: tests/measurements/dynamic_objects.py. Only rays
within the cone around a body are asked at all, and only those that hit one are asked whether the
scene hides it.
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

# Beyond every hit: a ray that met no body yet.
_NO_HIT = np.float32(1e30)
# Rays this much outside a body's cone are asked too: directions are float32.
_CONE_MARGIN = 1e-5
# So near a sphere is a poor guess: 65 degrees where a P2AT is seen within 47 in its own mirror.
_NEAR_RADII = 2.0
# A corner that is this near the viewpoint is all around it.
_MIN_DISTANCE_M = 1e-9

RayIndices = npt.NDArray[np.intp]


class EmbreeObjectScenes:
    """Embree scenes of bodies, one a mesh, committed when a mesh is first seen."""

    def __init__(self, lights: tuple[Light, ...]) -> None:
        self._lights = lights
        self._scenes: dict[ObjectMesh, rtcore_scene.EmbreeScene] = {}

    def __len__(self) -> int:
        """Return how many meshes were committed so far."""
        return len(self._scenes)

    def with_lights(self, lights: tuple[Light, ...]) -> EmbreeObjectScenes:
        """Return the same meshes in another light."""
        others = EmbreeObjectScenes(lights)
        others._scenes = self._scenes
        return others

    def place_objects(
        self, objects: tuple[DynamicObject, ...], viewpoint: Floats, scale: RadianceScale
    ) -> tuple[ObjectInstance, ...]:
        """Return bodies as a (3,) viewpoint meets them, lit where they stand."""
        return tuple(self._place_object(body, viewpoint, scale) for body in objects)

    def _place_object(
        self, dynamic_object: DynamicObject, viewpoint: Floats, scale: RadianceScale
    ) -> ObjectInstance:
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
    """A body in one exposure.

    viewpoint: (3,) in the body's frame. axis (3,), cosine: the cone around it, world frame.
    radiance: (3, n) of its triangles without point lights; table: (n,) the same, packed.
    """

    dynamic_object: DynamicObject
    embree_scene: rtcore_scene.EmbreeScene
    viewpoint: Floats
    cone_axis: Float32s
    cone_cosine: float
    radiance: Float32s
    radiance_table: Packed
    point_lights: tuple[Light, ...]

    def closest_hit(
        self, directions: Float32s, max_distance: Float32s
    ) -> tuple[RayIndices, Float32s, RayIndices]:
        """Return the rays that meet it before their (n,) distance: which, how far, what triangle.

        directions: (n, 3), world frame.
        """
        rays = np.flatnonzero(directions @ self.cone_axis >= self.cone_cosine)
        if not len(rays):
            return rays, np.zeros(0, np.float32), rays
        into_body = self.dynamic_object.world_from_object.rotation.astype(np.float32)
        local = directions.take(rays, axis=0) @ into_body
        origins = np.broadcast_to(self.viewpoint.astype(np.float32), local.shape)
        hit = self.embree_scene.run(origins, local, dists=max_distance.take(rays), output=True)
        met = np.flatnonzero(hit["primID"] >= 0)
        return rays[met], hit["tfar"][met], hit["primID"][met]

    def occludes(self, origins: Floats, directions: Float32s, max_distance: Float32s) -> Bools:
        """Return (n,) whether it is met before each ray's distance; world frame."""
        pose, mesh = self.dynamic_object.world_from_object, self.dynamic_object.mesh
        from_middle = origins - self.dynamic_object.centre
        along = np.einsum("ni,ni->n", from_middle, directions)
        aside = np.einsum("ni,ni->n", from_middle, from_middle) - along**2
        # Nothing of a body behind a ray's origin, or beside the ray, is met.
        near = aside <= mesh.radius_m**2 * (1.0 + _CONE_MARGIN) + _CONE_MARGIN
        rays = np.flatnonzero(near & (along <= mesh.radius_m))
        hidden = np.zeros(len(origins), dtype=bool)
        if len(rays):
            local = pose.inverse().transform_points(origins.take(rays, axis=0)).astype(np.float32)
            turned = directions.take(rays, axis=0) @ pose.rotation.astype(np.float32)
            reach = max_distance.take(rays)
            answer = self.embree_scene.run(local, turned, dists=reach, query="OCCLUDED")
            hidden[rays] = answer >= 0
        return hidden

    def shade(
        self, triangle: RayIndices, directions: Float32s, distance: Float32s, scale: RadianceScale
    ) -> Packed:
        """Return the (n,) packed light of hits: of a triangle, along a direction, how far."""
        if not self.point_lights:
            known: Packed = self.radiance_table.take(triangle)
            return known
        pose, mesh = self.dynamic_object.world_from_object, self.dynamic_object.mesh
        points = self._viewpoint_in_world(pose) + distance[:, None] * directions
        normals = pose.rotate_directions(mesh.normals[triangle])
        irradiance = shading.point_irradiance(self.point_lights, points, normals)
        irradiance[mesh.unlit[triangle]] = 0.0
        radiance = self.radiance[:, triangle] + (mesh.albedo[triangle] * irradiance).T
        return scale.pack(radiance.astype(np.float32))

    def _viewpoint_in_world(self, pose: Pose) -> Floats:
        return pose.transform_points(self.viewpoint)


class ShadedObject(Protocol):
    """A body that rays meet, with its light."""

    def closest_hit(
        self, directions: Float32s, max_distance: Float32s
    ) -> tuple[RayIndices, Float32s, RayIndices]:
        """Return the rays that meet it before their distance: which, how far, what triangle."""

    def shade(
        self, triangle: RayIndices, directions: Float32s, distance: Float32s, scale: RadianceScale
    ) -> Packed:
        """Return the (n,) packed light of hits."""


def intersect_objects(
    objects: Sequence[ShadedObject], directions: Float32s, scale: RadianceScale
) -> tuple[RayIndices, Float32s, Packed]:
    """Return which of (n, 3) rays meet a body, how far away the nearest is, and its light."""
    distance = np.full(len(directions), _NO_HIT)
    light = np.zeros(len(directions), dtype=np.uint64)
    for body in objects:
        rays, far, triangle = body.closest_hit(directions, distance)
        if len(rays):
            distance[rays] = far
            light[rays] = body.shade(triangle, directions[rays], far, scale)
    met = np.flatnonzero(distance < _NO_HIT)
    return met, distance[met], light[met]


def _bounding_cone(dynamic_object: DynamicObject, viewpoint: Floats) -> tuple[Floats, float]:
    """Return a (3,) axis and the cosine around it within which a body is; -2 for all directions.

    It is that of the sphere around the body; near it, as a robot's own mirror is, that of the
    corners: a cone of less than a half-space is convex, so it has all that is between them.
    """
    towards = dynamic_object.centre - viewpoint
    distance, radius = float(np.linalg.norm(towards)), dynamic_object.mesh.radius_m
    if distance > _NEAR_RADII * radius:
        return towards / distance, math.sqrt(1.0 - (radius / distance) ** 2)
    nowhere: tuple[Floats, float] = np.zeros(3), -2.0
    if distance == 0.0:
        return nowhere
    axis = towards / distance
    rays = (
        dynamic_object.world_from_object.transform_points(dynamic_object.mesh.corners) - viewpoint
    ).reshape(-1, 3)
    cosine = float((rays @ axis / np.maximum(np.linalg.norm(rays, axis=-1), _MIN_DISTANCE_M)).min())
    return (axis, cosine) if cosine > 0.0 else nowhere


def _commit_mesh(mesh: ObjectMesh) -> rtcore_scene.EmbreeScene:
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, mesh.corners.astype(np.float32))
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds it now
    return scene
