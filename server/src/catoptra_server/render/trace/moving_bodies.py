"""Bodies in Embree's hands: rays are turned into each body's frame, bodies are never rebuilt.

Committing all bodies in the world's frame and asking every ray takes 5.0 ms for one robot of 700
triangles, 11 ms for four and 29 ms for sixteen, per 100 000 rays; turning the rays that pass near
a body takes 1.4, 4.3 and 11 ms, and all threads share it: tests/cost/questions/bodies.py. Only rays
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

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render import shading
from catoptra_server.render.trace.packed_light import Float32s, Packed, Scale
from catoptra_server.scene.bodies import Body, BodyMesh, facets
from catoptra_server.scene.description import Light

# Beyond every hit: a ray that met no body yet.
_NOTHING = np.float32(1e30)
# Rays this much outside a body's cone are asked too: directions are float32.
_CONE_MARGIN = 1e-5
# So near a sphere is a poor guess: 65 degrees where a P2AT is seen within 47 in its own mirror.
_NEAR_RADII = 2.0
# A corner that is this near the viewpoint is all around it.
_TOUCHING_M = 1e-9

Rays = npt.NDArray[np.intp]


class BodyScenes:
    """Embree scenes of bodies, one a mesh, committed when a mesh is first seen."""

    def __init__(self, lights: tuple[Light, ...]) -> None:
        self._lights = lights
        self._scenes: dict[BodyMesh, rtcore_scene.EmbreeScene] = {}

    def __len__(self) -> int:
        """Return how many meshes were committed so far."""
        return len(self._scenes)

    def under(self, lights: tuple[Light, ...]) -> BodyScenes:
        """Return the same meshes in another light."""
        others = BodyScenes(lights)
        others._scenes = self._scenes
        return others

    def placed(
        self, bodies: tuple[Body, ...], viewpoint: Floats, scale: Scale
    ) -> tuple[PlacedBody, ...]:
        """Return bodies as a (3,) viewpoint meets them, lit where they stand."""
        return tuple(self._placed(body, viewpoint, scale) for body in bodies)

    def _placed(self, body: Body, viewpoint: Floats, scale: Scale) -> PlacedBody:
        if body.mesh not in self._scenes:
            self._scenes[body.mesh] = _committed(body.mesh)
        axis, cosine = _cone(body, viewpoint)
        radiance = shading.facet_radiance(facets(body), self._lights).T.astype(np.float32)
        return PlacedBody(
            body=body,
            embree=self._scenes[body.mesh],
            viewpoint=body.world_from_body.inverse().points(viewpoint),
            axis=axis.astype(np.float32),
            cosine=cosine - _CONE_MARGIN,
            radiance=radiance,
            table=scale.packed(radiance),
            lights=shading.point_lights(self._lights),
        )


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBody:
    """A body in one exposure.

    viewpoint: (3,) in the body's frame. axis (3,), cosine: the cone around it, world frame.
    radiance: (3, n) of its triangles without point lights; table: (n,) the same, packed.
    """

    body: Body
    embree: rtcore_scene.EmbreeScene
    viewpoint: Floats
    axis: Float32s
    cosine: float
    radiance: Float32s
    table: Packed
    lights: tuple[Light, ...]

    def nearer(self, directions: Float32s, distance: Float32s) -> tuple[Rays, Float32s, Rays]:
        """Return the rays that meet it before their (n,) distance: which, how far, what triangle.

        directions: (n, 3), world frame.
        """
        rays = np.flatnonzero(directions @ self.axis >= self.cosine)
        if not len(rays):
            return rays, np.zeros(0, np.float32), rays
        into_body = self.body.world_from_body.rotation.astype(np.float32)
        local = directions.take(rays, axis=0) @ into_body
        origins = np.broadcast_to(self.viewpoint.astype(np.float32), local.shape)
        hit = self.embree.run(origins, local, dists=distance.take(rays), output=True)
        met = np.flatnonzero(hit["primID"] >= 0)
        return rays[met], hit["tfar"][met], hit["primID"][met]

    def hides(self, origins: Floats, directions: Float32s, distance: Float32s) -> Bools:
        """Return (n,) whether it is met before each ray's distance; world frame."""
        pose, mesh = self.body.world_from_body, self.body.mesh
        from_middle = origins - self.body.centre
        along = np.einsum("ni,ni->n", from_middle, directions)
        aside = np.einsum("ni,ni->n", from_middle, from_middle) - along**2
        # Nothing of a body behind a ray's origin, or beside the ray, is met.
        near = aside <= mesh.radius_m**2 * (1.0 + _CONE_MARGIN) + _CONE_MARGIN
        rays = np.flatnonzero(near & (along <= mesh.radius_m))
        hidden = np.zeros(len(origins), dtype=bool)
        if len(rays):
            local = pose.inverse().points(origins.take(rays, axis=0)).astype(np.float32)
            turned = directions.take(rays, axis=0) @ pose.rotation.astype(np.float32)
            reach = distance.take(rays)
            answer = self.embree.run(local, turned, dists=reach, query="OCCLUDED")
            hidden[rays] = answer >= 0
        return hidden

    def light(
        self, triangle: Rays, directions: Float32s, distance: Float32s, scale: Scale
    ) -> Packed:
        """Return the (n,) packed light of hits: of a triangle, along a direction, how far."""
        if not self.lights:
            known: Packed = self.table.take(triangle)
            return known
        pose, mesh = self.body.world_from_body, self.body.mesh
        points = self._viewpoint_in_world(pose) + distance[:, None] * directions
        normals = pose.directions(mesh.normals[triangle])
        irradiance = shading.point_irradiance(self.lights, points, normals)
        irradiance[mesh.unlit[triangle]] = 0.0
        radiance = self.radiance[:, triangle] + (mesh.albedo[triangle] * irradiance).T
        return scale.packed(radiance.astype(np.float32))

    def _viewpoint_in_world(self, pose: Pose) -> Floats:
        return pose.points(self.viewpoint)


class LitBody(Protocol):
    """A body that rays meet, with its light."""

    def nearer(self, directions: Float32s, distance: Float32s) -> tuple[Rays, Float32s, Rays]:
        """Return the rays that meet it before their distance: which, how far, what triangle."""

    def light(
        self, triangle: Rays, directions: Float32s, distance: Float32s, scale: Scale
    ) -> Packed:
        """Return the (n,) packed light of hits."""


def body_hits(
    bodies: Sequence[LitBody], directions: Float32s, scale: Scale
) -> tuple[Rays, Float32s, Packed]:
    """Return which of (n, 3) rays meet a body, how far away the nearest is, and its light."""
    distance = np.full(len(directions), _NOTHING)
    light = np.zeros(len(directions), dtype=np.uint64)
    for body in bodies:
        rays, far, triangle = body.nearer(directions, distance)
        if len(rays):
            distance[rays] = far
            light[rays] = body.light(triangle, directions[rays], far, scale)
    met = np.flatnonzero(distance < _NOTHING)
    return met, distance[met], light[met]


def _cone(body: Body, viewpoint: Floats) -> tuple[Floats, float]:
    """Return a (3,) axis and the cosine around it within which a body is; -2 for all directions.

    It is that of the sphere around the body; near it, as a robot's own mirror is, that of the
    corners: a cone of less than a half-space is convex, so it has all that is between them.
    """
    towards = body.centre - viewpoint
    distance, radius = float(np.linalg.norm(towards)), body.mesh.radius_m
    if distance > _NEAR_RADII * radius:
        return towards / distance, math.sqrt(1.0 - (radius / distance) ** 2)
    nowhere: tuple[Floats, float] = np.zeros(3), -2.0
    if distance == 0.0:
        return nowhere
    axis = towards / distance
    rays = (body.world_from_body.points(body.mesh.corners) - viewpoint).reshape(-1, 3)
    cosine = float((rays @ axis / np.maximum(np.linalg.norm(rays, axis=-1), _TOUCHING_M)).min())
    return (axis, cosine) if cosine > 0.0 else nowhere


def _committed(mesh: BodyMesh) -> rtcore_scene.EmbreeScene:
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, mesh.corners.astype(np.float32))
    scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))  # builds it now
    return scene
