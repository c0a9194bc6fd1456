"""Meshes with their materials, placed among the rays of an exposure; their first hits.

Rays are moved into the frame of each mesh by an affine transform: one for all of them, or one for
each ray's time in an exposure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.reference.triangle_search import TriangleSearch
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import LitFacets, OcclusionMap
from catoptra_server.world.textures import (
    Levels,
    TextureSampling,
    build_levels,
    footprint_texels,
    sample_levels,
    uv_gradients,
    uv_steps,
)
from catoptra_server.world.world_description import Light

_Indices = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class WorldRays:
    """Rays in the world's axes, relative to the scene's centre."""

    origins: Floats
    """(n, 3) metres."""
    directions: Floats
    """(n, 3) unit."""
    steps: Floats
    """(n, 2, 3) from a direction to its neighbours to the right and below."""


@dataclass(frozen=True, slots=True, eq=False)
class FirstHits:
    """What each of n rays meets first."""

    distance: Floats
    """(n,) metres; inf for nothing."""
    object: _Indices
    """(n,) index of the mesh, or NOTHING."""
    triangle: _Indices
    """(n,) index of the triangle, or NOTHING."""
    weights: Floats
    """(n, 2) barycentric weights of corners 1 and 2."""


def find_first_hits(
    meshes: Sequence[PlacedMesh],
    rays: WorldRays,
    begin: Floats | None = None,
    least_coverage: float = 1.0,
) -> FirstHits:
    """First hits on any of the meshes; of equal distances the earlier mesh's.

    Behind (n,) distances, and on blended triangles from a coverage on: 1 where they are surfaces.
    """
    count = len(rays.origins)
    nothing = np.full(count, NOTHING, dtype=np.int32)
    first = FirstHits(np.full(count, np.inf), nothing, nothing.copy(), np.zeros((count, 2)))
    for number, placed in enumerate(meshes):
        # Rays are moved into the mesh's frame, and nothing is sorted anew. Directions keep the
        # length that the transform gives them: distances are then the world's.
        transform = placed.world_from_mesh
        distance, triangle, weights = placed.mesh.surface.first_hits(
            transform.inverse_points(rays.origins),
            transform.inverse_vectors(rays.directions),
            begin=begin,
            least_coverage=least_coverage,
        )
        nearer = np.flatnonzero(distance < first.distance)
        first.distance[nearer], first.object[nearer] = distance[nearer], number
        first.triangle[nearer], first.weights[nearer] = triangle[nearer], weights[nearer]
    return first


@dataclass(frozen=True, slots=True, eq=False)
class PlacedMesh:
    """A mesh among the rays of a batch."""

    mesh: TracedMesh
    """Geometry and materials."""
    world_from_mesh: _Affine
    """One transform, or one for each ray."""

    def albedo_at(self, hits: FirstHits, rays: WorldRays) -> Floats:
        """(n, 3) albedo where rays meet the mesh, by a texture if any."""
        turn = self.world_from_mesh.inverse_vectors
        right, below = (turn(step) for step in rays.steps.swapaxes(0, 1))
        steps = np.stack((right, below), axis=1)
        return self.mesh.albedo_at(
            hits, replace(rays, directions=turn(rays.directions), steps=steps)
        )

    def take(self, rays: npt.NDArray[np.intp]) -> PlacedMesh:
        """The same mesh among some of the rays."""
        return PlacedMesh(self.mesh, self.world_from_mesh.take(rays))


@dataclass(frozen=True, slots=True, eq=False)
class TracedMesh:
    """A mesh, its materials and its lights."""

    surface: TriangleSearch
    """Triangles that rays of the camera meet."""
    casters: TriangleSearch
    """Triangles that occlude lights."""
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
    """Texels of each texture, at all levels."""
    samplings: tuple[TextureSampling, ...] = ()
    """How each texture is sampled."""
    uv_gradients: Floats | None = None
    """(m, 2, 3) change of texture coordinates a metre, beside the texture index."""
    occlusion: OcclusionMap | None = None
    """Factors of hemisphere light, of the static scene alone."""
    gloss: Floats | None = None
    """(m, 2) as of `SceneMesh`; None: all are matt."""
    emission: Floats | None = None
    """(m, 3) linear radiance of their own; None: none."""
    corner_normals: Floats | None = None
    """(m, 3, 3) normals that light is reflected by; None: those of the facets."""
    two_sided: Bools | None = None
    """(m,) triangles whose backs are lit by the opposite normal; None: none."""
    blended: Bools | None = None
    """(m,) triangles that what lies behind shows through; None: none."""

    def opacities(self, hits: FirstHits) -> Floats:
        """(n,) opacities where rays meet the mesh."""
        assert isinstance(self.surface.filter, _FacetFilter), "what blends has a coverage"
        assert self.blended is not None, "none blends"
        coverage = self.surface.filter.find_coverage(hits.triangle, hits.weights)
        return np.where(self.blended[hits.triangle], np.minimum(0.5 * coverage, 1.0), 1.0)

    def shading_normals(self, hits: FirstHits, directions: Floats) -> Floats:
        """(n, 3) unit normals that light is reflected by where (n, 3) directions meet the mesh."""
        facets: Floats = self.facets.normals.take(hits.triangle, axis=0)
        normals = facets
        if self.corner_normals is not None:
            between = _interpolate_corners(
                self.corner_normals.take(hits.triangle, axis=0), hits.weights
            )
            length = np.linalg.norm(between, axis=-1, keepdims=True)
            normals = np.where(length > 0.0, between / np.where(length > 0.0, length, 1.0), facets)
        if self.two_sided is not None:
            is_back = self.two_sided[hits.triangle] & (
                np.einsum("ni,ni->n", facets, directions) > 0.0
            )
            normals = np.where(is_back[:, None], -normals, normals)
        return normals

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
            texels = sample_levels(levels, uv[those], footprint, self.samplings[number])
            albedo[those] *= texels[:, :3]
        return albedo


def _interpolate_corners(at_corners: Floats, weights: Floats) -> Floats:
    """(n, k) values between (n, 3, k) corners."""
    a, b, c = at_corners.swapaxes(0, 1)
    return np.asarray(a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a))


@dataclass(frozen=True, slots=True, eq=False)
class _FacetFilter:
    """What rays pass of some triangles of a scene: holes and, for cameras, backs.

    Twin: src/bvh.c:passes_facet.
    """

    scene: SceneMesh
    rows: npt.NDArray[np.intp]
    """(m,) triangles of the scene."""
    sees_backs: bool
    textures: tuple[Levels, ...]

    def __call__(
        self, triangle: _Indices, weights: Floats, directions: Floats, least_coverage: float
    ) -> Bools:
        """(k,) rays that pass the triangles that they meet."""
        scene, rows = self.scene, self.rows[triangle]
        passes = np.zeros(len(rows), dtype=bool)
        if scene.single_sided is not None and not self.sees_backs:
            facing = np.einsum("ni,ni->n", scene.normals[rows], directions)
            passes = scene.single_sided[rows] & (facing > 0.0)
        if scene.coverage is None:
            return passes
        least = np.ones(len(rows))
        if scene.blended is not None:
            least[scene.blended[rows]] = least_coverage
        return passes | ~(self.find_coverage(triangle, weights) >= least)

    def find_coverage(self, triangle: _Indices, weights: Floats) -> Floats:
        """(k,) coverage where rays meet triangles; infinite on those without holes."""
        scene, rows = self.scene, self.rows[triangle]
        assert scene.coverage is not None
        coverage = np.full(len(rows), np.inf)
        holed = np.flatnonzero(np.isfinite(scene.coverage[rows, 0]))
        opacity = _interpolate_corners(scene.coverage[rows[holed], :, None], weights[holed])[:, 0]
        uv = _interpolate_corners(scene.corner_uv[rows[holed]], weights[holed])
        for number, levels in enumerate(self.textures):
            those = np.flatnonzero(scene.texture_index[rows[holed]] == number)
            if levels[0].shape[-1] == 4:
                texels = sample_levels(
                    levels, uv[those], np.zeros(len(those)), scene.samplings[number]
                )
                opacity[those] *= texels[:, 3]
        coverage[holed] = opacity
        return coverage


def make_search(
    scene: SceneMesh,
    centre: Floats,
    textures: tuple[Levels, ...],
    rows: npt.NDArray[np.intp],
    *,
    sees_backs: bool,
) -> TriangleSearch:
    """Search among some triangles of a scene, relative to a centre, whose holes rays pass."""
    search = TriangleSearch(scene.corners[rows] - centre)
    if scene.coverage is not None or (scene.single_sided is not None and not sees_backs):
        search.filter = _FacetFilter(scene, rows, sees_backs, textures)
    return search


def trace_scene(scene: SceneMesh, centre: Floats, lights: tuple[Light, ...]) -> TracedMesh:
    """The static scene, relative to its centre, as the rays are."""
    textures = tuple(build_levels(texture) for texture in scene.textures)
    rows, casters = np.arange(len(scene)), np.flatnonzero(scene.casts_shadows)
    surface = make_search(scene, centre, textures, rows, sees_backs=False)
    is_same = len(casters) == len(rows) and scene.single_sided is None
    return TracedMesh(
        surface,
        surface if is_same else make_search(scene, centre, textures, casters, sees_backs=True),
        scene,
        lights,
        scene.corner_albedo,
        scene.texture_index if scene.textures else None,
        scene.corner_uv if scene.textures else None,
        textures,
        scene.samplings,
        uv_gradients(scene.corners, scene.corner_uv) if scene.textures else None,
        scene.occlusion,
        scene.gloss,
        scene.emission,
        scene.corner_normals,
        scene.two_sided,
        scene.blended,
    )


def trace_object(mesh: ObjectMesh, lights: tuple[Light, ...]) -> TracedMesh:
    """A dynamic object's mesh, in the object's frame."""
    surface = TriangleSearch(mesh.corners)
    return TracedMesh(
        surface,
        surface,
        mesh,
        lights,
        corner_normals=mesh.corner_normals,
        texture_index=mesh.texture_index if mesh.textures else None,
        uv=mesh.uv,
        textures=tuple(map(build_levels, mesh.textures)),
        samplings=mesh.samplings,
        uv_gradients=uv_gradients(mesh.corners, mesh.uv) if mesh.textures else None,
    )


def interpolate_poses(poses: Sequence[Pose], times: Floats | None) -> _Affine:
    """Transforms at (n,) times, linear between poses evenly spaced over [0, 1].

    One pose, or no times: the first pose for all rays.
    """
    if len(poses) == 1 or times is None:
        rotation = poses[0].rotation
        return _Affine(rotation, rotation.T, poses[0].translation)
    position = np.clip(times, 0.0, 1.0) * (len(poses) - 1)
    before = np.minimum(position.astype(np.intp), len(poses) - 2)
    fraction = (position - before)[:, None]
    rotations = np.stack([pose.rotation for pose in poses])
    offsets = np.stack([pose.translation for pose in poses])
    matrix = _interpolate(rotations, before, fraction[..., None])
    # Inverted once for points, vectors and normals; well conditioned between rotations.
    inverse = np.linalg.inv(matrix).astype(np.float64)
    return _Affine(matrix, inverse, _interpolate(offsets, before, fraction))


def _interpolate(values: Floats, before: npt.NDArray[np.intp], fraction: Floats) -> Floats:
    """Entries between two neighbours in a list of arrays."""
    return np.asarray((1.0 - fraction) * values[before] + fraction * values[before + 1])


@dataclass(frozen=True, slots=True, eq=False)
class _Affine:
    """Transform parent_from_child of (n, 3) points: one, or n of them."""

    matrix: Floats
    """(3, 3) or (n, 3, 3)."""
    inverse: Floats
    """Inverse of the matrix."""
    offset: Floats
    """(3,) or (n, 3)."""

    def take(self, rays: npt.NDArray[np.intp]) -> _Affine:
        """Transforms of some of the rays."""
        if self.matrix.ndim == 2:
            return self
        return _Affine(self.matrix[rays], self.inverse[rays], self.offset[rays])

    def points(self, in_child: Floats) -> Floats:
        """(n, 3) points in the parent frame."""
        return self.vectors(in_child) + self.offset

    def vectors(self, in_child: Floats) -> Floats:
        """(n, 3) vectors in the parent frame."""
        return _apply(self.matrix, in_child)

    def inverse_points(self, in_parent: Floats) -> Floats:
        """(n, 3) points in the child frame."""
        return _apply(self.inverse, in_parent - self.offset)

    def inverse_vectors(self, in_parent: Floats) -> Floats:
        """(n, 3) vectors in the child frame."""
        return _apply(self.inverse, in_parent)

    def normals(self, in_child: Floats) -> Floats:
        """(n, 3) unit normals in the parent frame; zero where they are zero."""
        # A matrix between two rotations is none itself: normals take its inverse transposed.
        found = _apply(np.swapaxes(self.inverse, -1, -2), in_child)
        length = np.linalg.norm(found, axis=-1, keepdims=True)
        return np.asarray(found / np.where(length > 0.0, length, 1.0))


def _apply(matrix: Floats, vectors: Floats) -> Floats:
    """(n, 3) products of one matrix, or of n, with (n, 3) vectors."""
    if matrix.ndim == 2:
        return np.asarray(vectors @ matrix.T)
    return np.asarray(np.einsum("nij,nj->ni", matrix, vectors))
