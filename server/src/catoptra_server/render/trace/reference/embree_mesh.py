"""A mesh in Embree, which finds the triangle; where the ray hits it is computed in float64."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass

Triangles = npt.NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class MeshHits:
    """First hits of n rays on a mesh."""

    distance: Floats
    """(n,) distances in lengths of the direction; inf without a hit."""
    triangle: Triangles
    """(n,) triangles; -1 without a hit."""
    weights: Floats
    """(n, 2) barycentric weights of corners 1 and 2; zero without a hit."""


class EmbreeMesh:
    """Triangles, committed for ray queries. Thread-safe once built: queries only read."""

    def __init__(self, corners: Floats) -> None:
        """Commit (n, 3, 3) corners. Float32 in Embree: their origin should be near."""
        self._corners = corners
        # Embree commits no empty scene.
        self._scene = None if len(corners) == 0 else rtcore_scene.EmbreeScene()
        if self._scene is not None:
            TriangleMesh(self._scene, corners.astype(np.float32))
            # Embree builds its hierarchy at the first query: now, not in a thread of many.
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))

    def first_hits(self, origins: Floats, directions: Floats) -> MeshHits:
        """First hits of rays from (n, 3) origins along (n, 3) directions of any length."""
        triangle = self._run(origins, directions)
        distance, weights = np.full(len(origins), np.inf), np.zeros((len(origins), 2))
        rays = np.flatnonzero(triangle >= 0)
        corners = self._corners.take(triangle[rays], axis=0)
        distance[rays], weights[rays] = hit_triangles(origins[rays], directions[rays], corners)
        return MeshHits(distance, triangle, weights)

    def occludes(self, origins: Floats, directions: Floats, max_distance: Floats) -> Bools:
        """(n,) whether a triangle lies before each ray's `max_distance`, as `first_hits` counts."""
        limits = max_distance.astype(np.float32)
        return np.asarray(self._run(origins, directions, query="OCCLUDED", dists=limits) >= 0)

    def _run(self, origins: Floats, directions: Floats, **options: object) -> Triangles:
        """Triangles that Embree reports, -1 for none."""
        if self._scene is None:
            return np.full(len(origins), -1, dtype=np.int32)
        rays = origins.astype(np.float32), directions.astype(np.float32)
        return np.asarray(self._scene.run(*rays, **options))


def hit_triangles(origins: Floats, directions: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Where rays hit triangles that they are known to hit.

    Source: Moeller & Trumbore 1997. A ray that misses its triangle by Embree's rounding hits its
    edge.

    Args:
        origins: (n, 3).
        directions: (n, 3), of any length.
        corners: (n, 3, 3).

    Returns:
        (n,) distances in lengths of the direction, and (n, 2) barycentric weights of corners 1
        and 2.
    """
    first = corners[:, 0]
    edge1, edge2 = corners[:, 1] - first, corners[:, 2] - first
    normal_to_edge2, from_first = np.cross(directions, edge2), origins - first
    determinant = _dot(edge1, normal_to_edge2)
    # Zero for a ray along the triangle's plane: the weights are then any in the triangle.
    scale = 1.0 / np.where(determinant == 0.0, 1.0, determinant)
    weight1 = np.clip(scale * _dot(from_first, normal_to_edge2), 0.0, 1.0)
    weight2 = scale * _dot(directions, np.cross(from_first, edge1))
    weight2 = np.clip(weight2, 0.0, 1.0 - weight1)
    to_hit = weight1[:, None] * edge1 + weight2[:, None] * edge2 - from_first
    distance = _dot(to_hit, directions) / _dot(directions, directions)
    return np.maximum(distance, 0.0), np.stack((weight1, weight2), axis=-1)


def _dot(a: Floats, b: Floats) -> Floats:
    """(n,) products of (n, 3) vectors."""
    return np.asarray(np.einsum("ni,ni->n", a, b))
