"""Meshes with their materials, placed among the rays of an exposure; their first hits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.trace.reference.affine import Affine
from catoptra_server.render.trace.reference.embree_mesh import EmbreeMesh
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.dynamic_object import ObjectMesh
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.shading import sample_texture
from catoptra_server.scene.texture_files import Texture
from catoptra_server.scene.world_description import Light


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Rays in the world's axes, relative to the scene's centre."""

    origins: Floats
    """(n, 3) metres."""
    directions: Floats
    """(n, 3) unit."""

    def take(self, rays: npt.NDArray[np.intp]) -> Rays:
        """Some of the rays."""
        return Rays(self.origins[rays], self.directions[rays])


@dataclass(frozen=True, slots=True, eq=False)
class TextureMap:
    """Textures of a mesh."""

    index: npt.NDArray[np.int32]
    """(m,) texture of each triangle; -1 for none."""
    uv: Floats
    """(m, 3, 2) texture coordinates."""
    linear: tuple[npt.NDArray[np.float32], ...]
    """(h, w, 3) linear texels; in float64 a texture of 4096 px would take 400 MB."""


@dataclass(frozen=True, slots=True, eq=False)
class TracedMesh:
    """A mesh in Embree, its materials and its lights."""

    surface: EmbreeMesh
    """Triangles that rays of the camera meet."""
    casters: EmbreeMesh
    """Those of them that occlude lights."""
    normals: Floats
    """(m, 3) unit."""
    albedo: Floats
    """(m, 3) linear."""
    unlit: Bools
    """(m,) whether a triangle is shown at its albedo."""
    lights: tuple[Light, ...]
    """Lights that shine on the mesh."""
    textures: TextureMap | None = None
    """None: one albedo a triangle."""

    def albedo_at(self, triangle: npt.NDArray[np.int32], weights: Floats) -> Floats:
        """(n, 3) albedo at (n, 2) barycentric weights of (n,) triangles."""
        albedo = self.albedo[triangle]
        if self.textures is None:
            return albedo
        index, (a, b, c) = self.textures.index[triangle], self.textures.uv[triangle].swapaxes(0, 1)
        uv = a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a)
        for number, texels in enumerate(self.textures.linear):
            rays = np.flatnonzero(index == number)
            albedo[rays] *= sample_texture(texels, uv[rays])  # type: ignore[arg-type]
        return albedo


def trace_scene(scene: SceneMesh, centre: Floats, lights: tuple[Light, ...]) -> TracedMesh:
    """The static scene, relative to its centre so that float32 keeps its precision there."""
    corners = scene.corners - centre
    surface = EmbreeMesh(corners)
    all_cast = bool(scene.casts_shadows.all())
    return TracedMesh(
        surface,
        surface if all_cast else EmbreeMesh(corners[scene.casts_shadows]),
        scene.normals,
        scene.albedo,
        scene.unlit,
        lights,
        TextureMap(scene.texture_index, scene.uv, tuple(map(_linear_texels, scene.textures))),
    )


def trace_object(mesh: ObjectMesh, lights: tuple[Light, ...]) -> TracedMesh:
    """A dynamic object's mesh, in the object's frame."""
    surface = EmbreeMesh(mesh.corners)
    return TracedMesh(surface, surface, mesh.normals, mesh.albedo, mesh.unlit, lights)


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
class FirstHits:
    """What each of n rays meets first."""

    distance: Floats
    """(n,) metres; inf for nothing."""
    object: npt.NDArray[np.int32]
    """(n,) index of the mesh, or NOTHING."""
    triangle: npt.NDArray[np.int32]
    """(n,) index of the triangle, or NOTHING."""
    weights: Floats
    """(n, 2) barycentric weights of corners 1 and 2."""

    def take(self, rays: npt.NDArray[np.intp]) -> FirstHits:
        """Hits of some of the rays."""
        return FirstHits(
            self.distance[rays], self.object[rays], self.triangle[rays], self.weights[rays]
        )


def find_first_hits(meshes: Sequence[PlacedMesh], rays: Rays) -> FirstHits:
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
