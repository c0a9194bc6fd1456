"""Meshes with their materials, placed among the rays of an exposure; their first hits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.reference.affine import Affine
from catoptra_server.render.trace.reference.embree_mesh import EmbreeMesh
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.occlusion_map import OcclusionMap
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import LitFacets
from catoptra_server.world.textures import (
    Levels,
    build_levels,
    footprint_texels,
    sample_levels,
    uv_gradients,
    uv_steps,
)
from catoptra_server.world.world_description import Light

Indices = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class TracedMesh:
    """A mesh in Embree, its materials and its lights."""

    surface: EmbreeMesh
    """Triangles that rays of the camera meet."""
    casters: EmbreeMesh
    """Those of them that occlude lights."""
    facets: LitFacets
    """Normals and materials of all triangles, in the mesh's frame."""
    lights: tuple[Light, ...]
    """Lights that shine on the mesh."""
    corner_albedo: Floats | None = None
    """(m, 3, 3) linear; None: one albedo a triangle."""
    texture_index: npt.NDArray[np.int32] | None = None
    """(m,) texture of each triangle, -1 for none; None for a mesh without textures."""
    uv: Floats | None = None
    """(m, 3, 2) texture coordinates, beside the texture index."""
    textures: tuple[Levels, ...] = ()
    """Linear texels of each texture, at all levels."""
    uv_gradients: Floats | None = None
    """(m, 2, 3) change of texture coordinates a metre, beside the texture index."""
    occlusion: OcclusionMap | None = None
    """Factors of hemisphere light, of the static scene alone."""

    def albedo_at(self, hits: FirstHits, rays: WorldRays) -> Floats:
        """(n, 3) albedo where rays meet the mesh in its own frame, by a texture if any."""
        triangle, weights = hits.triangle, hits.weights
        albedo = self.facets.albedo.take(triangle, axis=0)
        if self.corner_albedo is not None:
            albedo = _interpolate_corners(self.corner_albedo.take(triangle, axis=0), weights)
        if self.texture_index is None or self.uv is None or self.uv_gradients is None:
            return albedo
        texture = self.texture_index[triangle]
        uv = _interpolate_corners(self.uv.take(triangle, axis=0), weights)
        steps = uv_steps(
            self.uv_gradients.take(triangle, axis=0),
            self.facets.normals.take(triangle, axis=0),
            hits.distance,
            rays.directions,
            rays.steps,
        )
        for number, levels in enumerate(self.textures):
            those = np.flatnonzero(texture == number)
            height, width = levels[0].shape[:2]
            footprint = footprint_texels(steps[those], (width, height))
            albedo[those] *= sample_levels(levels, uv[those], footprint)
        return albedo


def _interpolate_corners(at_corners: Floats, weights: Floats) -> Floats:
    """(n, k) values between (n, 3, k) corners."""
    a, b, c = at_corners.swapaxes(0, 1)
    return np.asarray(a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a))


def trace_scene(scene: SceneMesh, centre: Floats, lights: tuple[Light, ...]) -> TracedMesh:
    """The static scene, relative to its centre so that float32 keeps its precision there."""
    surface = EmbreeMesh(scene.corners - centre)
    all_cast = bool(scene.casts_shadows.all())
    return TracedMesh(
        surface,
        surface if all_cast else EmbreeMesh(scene.corners[scene.casts_shadows] - centre),
        scene,
        lights,
        scene.corner_albedo,
        scene.texture_index if scene.textures else None,
        scene.uv if scene.textures else None,
        tuple(build_levels(texture) for texture in scene.textures),
        uv_gradients(scene.corners, scene.uv) if scene.textures else None,
        scene.occlusion,
    )


def trace_object(mesh: ObjectMesh, lights: tuple[Light, ...]) -> TracedMesh:
    """A dynamic object's mesh, in the object's frame."""
    surface = EmbreeMesh(mesh.corners)
    return TracedMesh(surface, surface, mesh, lights)


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMesh:
    """A mesh among the rays of a batch."""

    mesh: TracedMesh
    """Geometry and materials."""
    world_from_mesh: Affine
    """One transform, or one for each ray."""

    def take(self, rays: npt.NDArray[np.intp]) -> PlacedMesh:
        """The same mesh among some of the rays."""
        return PlacedMesh(self.mesh, self.world_from_mesh.take(rays))


@dataclass(frozen=True, slots=True, eq=False)
class WorldRays:
    """Rays in the world's axes, relative to the scene's centre."""

    origins: Floats
    """(n, 3) metres."""
    directions: Floats
    """(n, 3) unit."""
    steps: Floats
    """(n, 2, 3) from a direction to those of the samples to the right and below."""


@dataclass(frozen=True, slots=True, eq=False)
class FirstHits:
    """What each of n rays meets first."""

    distance: Floats
    """(n,) metres; inf for nothing."""
    object: Indices
    """(n,) index of the mesh, or NOTHING."""
    triangle: Indices
    """(n,) index of the triangle, or NOTHING."""
    weights: Floats
    """(n, 2) barycentric weights of corners 1 and 2."""


def find_first_hits(meshes: Sequence[PlacedMesh], rays: WorldRays) -> FirstHits:
    """First hits on any of the meshes; of equal distances the earlier mesh's."""
    count = len(rays.origins)
    nothing = np.full(count, NOTHING, dtype=np.int32)
    first = FirstHits(np.full(count, np.inf), nothing, nothing.copy(), np.zeros((count, 2)))
    for number, placed in enumerate(meshes):
        # Rays are moved into the mesh's frame, and nothing is committed anew. Directions keep the
        # length that the transform gives them: distances are then those of the world.
        transform = placed.world_from_mesh
        hits = placed.mesh.surface.first_hits(
            transform.inverse_points(rays.origins), transform.inverse_vectors(rays.directions)
        )
        nearer = np.flatnonzero(hits.distance < first.distance)
        first.distance[nearer], first.object[nearer] = hits.distance[nearer], number
        first.triangle[nearer], first.weights[nearer] = hits.triangle[nearer], hits.weights[nearer]
    return first
