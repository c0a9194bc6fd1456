"""Meshes with their materials, placed among the rays of an exposure; their first hits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.reference.affine import Affine
from catoptra_server.render.trace.reference.embree_mesh import EmbreeMesh
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.dynamic_object import ObjectMesh
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import LitFacets, sample_texture
from catoptra_server.scene.texture_files import Texture
from catoptra_server.scene.world_description import Light

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
    textures: tuple[npt.NDArray[np.float32], ...] = ()
    """(h, w, 3) linear texels; in float64 a texture of 4096 px would take 400 MB."""

    def albedo_at(self, triangle: Indices, weights: Floats) -> Floats:
        """(n, 3) albedo at (n, 2) barycentric weights of (n,) triangles, by a texture if any."""
        albedo = self.facets.albedo.take(triangle, axis=0)
        if self.corner_albedo is not None:
            albedo = _interpolate(self.corner_albedo.take(triangle, axis=0), weights)
        if self.texture_index is None or self.uv is None:
            return albedo
        texture, uv = (
            self.texture_index[triangle],
            _interpolate(self.uv.take(triangle, axis=0), weights),
        )
        for number, texels in enumerate(self.textures):
            rays = np.flatnonzero(texture == number)
            # Float64 by its coordinates, whatever the texels are.
            albedo[rays] *= sample_texture(cast(Floats, texels), uv[rays])
        return albedo


def _interpolate(at_corners: Floats, weights: Floats) -> Floats:
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
        tuple(_linear_texels(texture) for texture in scene.textures),
    )


def trace_object(mesh: ObjectMesh, lights: tuple[Light, ...]) -> TracedMesh:
    """A dynamic object's mesh, in the object's frame."""
    surface = EmbreeMesh(mesh.corners)
    return TracedMesh(surface, surface, mesh, lights)


def _linear_texels(texture: Texture) -> npt.NDArray[np.float32]:
    """(h, w, 3) linear light of an sRGB image."""
    return linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)[texture]


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
