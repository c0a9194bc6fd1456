"""The flat surfaces of a scene, their edges, and clusters of triangles too small for either.

An image changes from one surface to the next only at edges. So a part of the image that no edge
crosses and that one surface surrounds is that surface throughout: `cells` fills it without rays.
Small triangles have too many edges for that; a sphere around each cluster of them marks the cells
that need rays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene.scene_mesh import SceneMesh

Indices = npt.NDArray[np.int32]

# First rows of every table of surfaces: triangles that are part of no surface, and the background.
NO_SURFACE, BACKGROUND = 0, 1
_FIRST = 2

# Limits for triangles with edges of their own, and for clusters. More clusters fit closer and cost
# more: in a scene of 500 balls of 2000 triangles 1000, 2000, 4000 and 9000 take 1.12, 1.17, 1.05
# and 1.05 times the processor time of tracing every ray; with 30 balls 3000 and 6000 take 0.38 and
# 0.42 times.
_MAX_LARGE = 4000
_MAX_CLUSTERS = 8000
# Two triangles lie in one plane if their unit normals agree to this: 1e-5 rad.
_SAME_NORMAL = 1.0 - 5e-11
_SAME_UV = 1e-9
# Corners of neighbours result from different sums: within a nanometre both are one vertex.
_SAME_POSITION_DIGITS = 9


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """The surfaces of a scene: connected coplanar triangles of one material. World frame."""

    of_triangle: Indices
    """(n + 1,) surface of each triangle; the last is that of a ray without a hit."""
    triangle: Indices
    """(s,) one triangle of each surface, -1 for none."""
    centre: Floats
    """(s, 3) centres of spheres around the surfaces."""
    reach_m: Floats
    """(s,) radii of these spheres."""
    edges: Floats
    """(e, 2, 3) ends of the lines that bound surfaces."""
    cluster_centre: Floats
    """(k, 3) centres of spheres around triangles of no surface."""
    cluster_radius_m: Floats
    """(k,) radii of these spheres."""


def find_surfaces(scene: SceneMesh) -> Surfaces:
    """Surfaces, edges and clusters of a scene."""
    size = _clusters_side(scene)
    large = np.flatnonzero(_longest_edge(scene.corners) > size)
    small = np.flatnonzero(_longest_edge(scene.corners) <= size)
    pairs, edges = _shared_and_outer_edges(scene, large)
    label, representative = _connected_components(len(large), pairs)
    of_triangle = np.full(len(scene) + 1, NO_SURFACE, dtype=np.int32)
    of_triangle[large] = label + _FIRST
    of_triangle[-1] = BACKGROUND
    centre, reach = _spheres(scene.corners[large], label, len(representative))
    cluster_centre, cluster_radius = _clusters(scene.corners[small], size)
    none = np.zeros((_FIRST, 3))
    return Surfaces(
        of_triangle=of_triangle,
        triangle=np.append([-1, -1], large[representative]).astype(np.int32),
        centre=np.concatenate((none, centre)),
        reach_m=np.append([0.0, 0.0], reach),
        edges=edges,
        cluster_centre=cluster_centre,
        cluster_radius_m=cluster_radius,
    )


def _longest_edge(corners: Floats) -> Floats:
    """(n,) length of each triangle's longest edge."""
    edges = corners - np.roll(corners, 1, axis=1)
    longest: Floats = np.sqrt(np.square(edges).sum(axis=-1).max(axis=-1, initial=0.0))
    return longest


def _clusters_side(scene: SceneMesh) -> float:
    """Least side of clusters that leaves few enough triangles and clusters, metres; 0 = none."""
    if len(scene) <= _MAX_LARGE:
        return 0.0
    longest = np.sort(_longest_edge(scene.corners))
    # Not so small that the numbers of the cubes leave 63 bits.
    extent = float(np.ptp(scene.corners.reshape(-1, 3), axis=0).max())
    side = max(float(longest[-_MAX_LARGE]), 1e-5 * extent)
    centres = scene.corners.mean(axis=1)
    while len(np.unique(_voxels(centres, side))) > _MAX_CLUSTERS:
        side *= 1.2
    return side


def _voxels(points: Floats, side: float) -> npt.NDArray[np.int64]:
    """(n,) number of the cube that contains each of (n, 3) points."""
    cell = np.floor((points - points.min(axis=0, initial=np.inf)) / side).astype(np.int64)
    count = cell.max(axis=0, initial=0) + 1
    numbers: npt.NDArray[np.int64] = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
    return numbers


def _clusters(corners: Floats, side: float) -> tuple[Floats, Floats]:
    """(k, 3) centres and (k,) radii of spheres around clusters of triangles."""
    if not len(corners):
        return np.zeros((0, 3)), np.zeros(0)
    _, cluster = np.unique(_voxels(corners.mean(axis=1), side), return_inverse=True)
    return _spheres(corners, cluster, int(cluster.max()) + 1)


def _spheres(corners: Floats, group: npt.NDArray[np.integer], groups: int) -> tuple[Floats, Floats]:
    """(g, 3) centres and (g,) radii of spheres around groups of (n, 3, 3) triangles."""
    if not groups:
        return np.zeros((0, 3)), np.zeros(0)
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(groups))
    lowest = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    highest = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    centres: Floats = 0.5 * (lowest + highest)
    reach = np.linalg.norm(corners - centres[group][:, None], axis=-1).max(axis=-1)
    radii: Floats = np.maximum.reduceat(reach[order], starts)
    return centres, radii


def _shared_and_outer_edges(
    scene: SceneMesh, large: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], Floats]:
    """Pairs of large triangles that continue each other, (p, 2), and all other edges."""
    if not len(large):
        return np.zeros((0, 2), np.intp), np.zeros((0, 2, 3))
    corners = scene.corners[large].reshape(-1, 3).round(_SAME_POSITION_DIGITS)
    points, corner = np.unique(corners, axis=0, return_inverse=True)
    triangles = corner.reshape(-1, 3)
    ends = np.sort(np.stack((triangles, np.roll(triangles, -1, axis=1)), axis=-1), axis=-1)
    edge, owner, count = np.unique(
        ends.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
    )
    order = np.argsort(owner.reshape(-1), kind="stable")
    first = np.cumsum(count) - count
    twice = np.flatnonzero(count == 2)
    pairs = np.stack((order[first[twice]] // 3, order[first[twice] + 1] // 3), axis=-1)
    continued = _continue_each_other(scene, large[pairs])
    outer = np.delete(edge, twice[continued], axis=0)
    return pairs[continued], points[outer]


def _continue_each_other(scene: SceneMesh, pairs: npt.NDArray[np.intp]) -> Bools:
    """(p,) whether two neighbours are coplanar and of one material."""
    a, b = pairs[:, 0], pairs[:, 1]
    alike: Bools = np.einsum("ij,ij->i", scene.normals[a], scene.normals[b]) > _SAME_NORMAL
    alike &= (scene.albedo[a] == scene.albedo[b]).all(axis=-1)
    alike &= scene.unlit[a] == scene.unlit[b]
    alike &= scene.texture_index[a] == scene.texture_index[b]
    textured = np.flatnonzero(alike & (scene.texture_index[a] >= 0))
    offset, gradient = uv_planes(scene, a[textured])
    there = np.einsum("pci,pki->pck", scene.corners[b[textured]], gradient) + offset[:, None]
    alike[textured] = (np.abs(there - scene.uv[b[textured]]) < _SAME_UV).all(axis=(1, 2))
    return alike


def uv_planes(scene: SceneMesh, triangle: npt.NDArray[np.integer]) -> tuple[Floats, Floats]:
    """Texture coordinates of triangles' planes: (n, 2) at the origin, (n, 2, 3) gradients."""
    corners, uv = scene.corners[triangle], scene.uv[triangle]
    edges = corners[:, 1:] - corners[:, :1]
    # The dual of the two edges within their plane; a triangle without area has none.
    gram = np.einsum("nai,nbi->nab", edges, edges)
    area = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    adjugate = np.stack((gram[:, 1, 1], -gram[:, 0, 1], -gram[:, 1, 0], gram[:, 0, 0]), axis=-1)
    inverse = adjugate.reshape(-1, 2, 2) / np.where(area > 0.0, area, 1.0)[:, None, None]
    dual = np.einsum("nab,nbi->nai", inverse, edges)
    gradient = np.einsum("nak,nai->nki", uv[:, 1:] - uv[:, :1], dual)
    offset = uv[:, 0] - np.einsum("nki,ni->nk", gradient, corners[:, 0])
    return offset, gradient


def _connected_components(
    count: int, pairs: npt.NDArray[np.intp]
) -> tuple[Indices, npt.NDArray[np.intp]]:
    """(count,) group of each element joined by (p, 2) pairs, and one element of each group."""
    label = np.arange(count)
    while True:
        smallest = label.copy()
        np.minimum.at(smallest, pairs[:, 0], label[pairs[:, 1]])
        np.minimum.at(smallest, pairs[:, 1], label[pairs[:, 0]])
        smallest = smallest[smallest]  # halves the length of chains
        if (smallest == label).all():
            break
        label = smallest
    representative, group = np.unique(label, return_inverse=True)
    return group.astype(np.int32), representative
