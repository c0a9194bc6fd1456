"""The flat surfaces of a scene, and clusters of the triangles that are too small to be one.

The kernel proves for parts of an image that one surface fills them (`src/coverage.h`). Every
surface is a candidate in every part of the image, so their number is limited; small triangles are
enclosed in spheres, which can only prevent a proof.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.textures import uv_gradients

Indices = npt.NDArray[np.int32]

# Candidates of a frame: each costs 5 ns for each of 100 parts of an image.
_MAX_LARGE = 4000
_MAX_CLUSTERS = 500
# Beyond, no sensible part of an image shows one surface, and finding surfaces takes a second for a
# million triangles.
MAX_TRIANGLES = 200_000
# Two triangles lie in one plane if their unit normals agree to this: 1e-5 rad.
_SAME_NORMAL = 1.0 - 5e-11
_SAME_UV = 1e-9
# Corners of neighbours result from different sums: within a nanometre both are one vertex.
_SAME_POSITION_DIGITS = 9


@dataclass(frozen=True, slots=True, eq=False)
class FlatSurfaces:
    """Surfaces of a scene: connected coplanar triangles of one material. World frame."""

    triangles: Indices
    """(m,) triangles that belong to surfaces."""
    surface: Indices
    """(m,) surface of each."""
    outer_edges: npt.NDArray[np.uint8]
    """(m,) bit masks of the edges that bound a surface; bit k is the edge from corner k on."""
    representative: Indices
    """(s,) largest triangle of each surface."""
    clusters: Floats
    """(c, 4) centres and radii of spheres around all other triangles, metres."""


def find_flat_surfaces(scene: SceneMesh) -> FlatSurfaces:
    """Surfaces and clusters of a scene; none at all for a scene of very many triangles."""
    if not 0 < len(scene) <= MAX_TRIANGLES:
        return _NO_SURFACES
    longest = _longest_edge(scene.corners)
    side = _cluster_side(scene.corners, longest)
    large, small = np.flatnonzero(longest > side), np.flatnonzero(longest <= side)
    pairs, outer_edges = _join_triangles(scene, large)
    surface = _connected_components(len(large), pairs)
    return FlatSurfaces(
        triangles=large.astype(np.int32),
        surface=surface,
        outer_edges=outer_edges,
        representative=_largest_of_each(scene.corners, large, surface),
        clusters=_enclose_clusters(scene.corners[small], side),
    )


_NO_SURFACES = FlatSurfaces(
    triangles=np.zeros(0, np.int32),
    surface=np.zeros(0, np.int32),
    outer_edges=np.zeros(0, np.uint8),
    representative=np.zeros(0, np.int32),
    clusters=np.zeros((0, 4)),
)


def _longest_edge(corners: Floats) -> Floats:
    """(n,) length of each triangle's longest edge."""
    edges = corners - np.roll(corners, 1, axis=1)
    longest: Floats = np.sqrt(np.square(edges).sum(axis=-1).max(axis=-1, initial=0.0))
    return longest


def _cluster_side(corners: Floats, longest: Floats) -> float:
    """Least side of clusters that leaves few enough triangles and clusters, metres; -1: none."""
    if len(corners) <= _MAX_LARGE:
        return -1.0
    # Not so small that the numbers of the cubes leave 63 bits.
    extent = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    side = max(float(np.partition(longest, -_MAX_LARGE)[-_MAX_LARGE]), 1e-5 * extent)
    centres = corners.mean(axis=1)
    while len(np.unique(_number_cubes(centres, side))) > _MAX_CLUSTERS:
        side *= 1.5
    return side


def _number_cubes(points: Floats, side: float) -> npt.NDArray[np.int64]:
    """(n,) number of the cube that contains each of (n, 3) points."""
    cell = np.floor((points - points.min(axis=0, initial=np.inf)) / side).astype(np.int64)
    count = cell.max(axis=0, initial=0) + 1
    numbers: npt.NDArray[np.int64] = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
    return numbers


def _enclose_clusters(corners: Floats, side: float) -> Floats:
    """(c, 4) centres and radii of spheres around the triangles of each cube."""
    if not len(corners):
        return np.zeros((0, 4))
    _, group = np.unique(_number_cubes(corners.mean(axis=1), side), return_inverse=True)
    order = np.argsort(group, kind="stable")
    starts = np.searchsorted(group[order], np.arange(int(group.max()) + 1))
    lowest = np.minimum.reduceat(corners.min(axis=1)[order], starts)
    highest = np.maximum.reduceat(corners.max(axis=1)[order], starts)
    centres = 0.5 * (lowest + highest)
    reach = np.linalg.norm(corners - centres[group][:, None], axis=-1).max(axis=-1)
    return np.column_stack((centres, np.maximum.reduceat(reach[order], starts)))


def _largest_of_each(corners: Floats, large: npt.NDArray[np.intp], surface: Indices) -> Indices:
    """(s,) triangle with the largest area of each surface: its plane is the best known."""
    cross = np.cross(corners[large, 1] - corners[large, 0], corners[large, 2] - corners[large, 0])
    order = np.lexsort((-np.linalg.norm(cross, axis=-1), surface))
    first = np.searchsorted(surface[order], np.arange(int(surface.max(initial=-1)) + 1))
    return large[order[first]].astype(np.int32)


def _join_triangles(
    scene: SceneMesh, large: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.uint8]]:
    """(p, 2) pairs of large triangles that continue each other, and the edges without any pair."""
    corners = scene.corners[large].reshape(-1, 3).round(_SAME_POSITION_DIGITS)
    _, corner = np.unique(_number_rows(corners), return_inverse=True)
    triangles = corner.reshape(-1, 3)
    follower = np.roll(triangles, -1, axis=1)
    ends = np.sort(np.stack((triangles, follower), axis=-1), axis=-1)
    numbers = _number_rows(ends.reshape(-1, 2))
    _, edge, count = np.unique(numbers, return_inverse=True, return_counts=True)
    order = np.argsort(edge.reshape(-1), kind="stable")
    first = (np.cumsum(count) - count)[count == 2]
    # Flat indices 3 * triangle + edge of the two sides of each edge that two triangles share.
    sides = np.stack((order[first], order[first + 1]), axis=-1)
    # One edge, one normal: the triangles lie on its two sides if they pass it in opposite
    # directions. Copies of one triangle do not, and end there.
    is_forward = (triangles < follower).reshape(-1)[sides]
    sides = sides[is_forward[:, 0] != is_forward[:, 1]]
    sides = sides[_continue_each_other(scene, large[sides // 3])]
    is_outer = np.ones(3 * len(large), dtype=bool)
    is_outer[sides.reshape(-1)] = False
    return sides // 3, (is_outer.reshape(-1, 3) @ np.array([1, 2, 4])).astype(np.uint8)


def _number_rows(rows: npt.NDArray[np.generic]) -> npt.NDArray[np.int64]:
    """(n,) numbers that order and tell apart (n, k) rows, as their elements do.

    Sorted column by column: `np.unique` of whole rows takes seven times as long.
    """
    numbers = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        values, rank = np.unique(column, return_inverse=True)
        numbers = numbers * len(values) + rank
    return numbers


def _continue_each_other(scene: SceneMesh, pairs: npt.NDArray[np.intp]) -> Bools:
    """(p,) whether two neighbours are coplanar and of one material."""
    a, b = pairs[:, 0], pairs[:, 1]
    alike: Bools = np.einsum("ij,ij->i", scene.normals[a], scene.normals[b]) > _SAME_NORMAL
    alike &= (scene.albedo[a] == scene.albedo[b]).all(axis=-1)
    alike &= scene.unlit[a] == scene.unlit[b]
    # One surface has one label.
    alike &= scene.object_index[a] == scene.object_index[b]
    alike &= scene.texture_index[a] == scene.texture_index[b]
    has_colours = has_corner_colours(scene)
    alike &= ~has_colours[a] & ~has_colours[b]
    textured = np.flatnonzero(alike & (scene.texture_index[a] >= 0))
    offset, gradient = uv_planes(scene, a[textured])
    there = np.einsum("pci,pki->pck", scene.corners[b[textured]], gradient) + offset[:, None]
    alike[textured] = (np.abs(there - scene.uv[b[textured]]) < _SAME_UV).all(axis=(1, 2))
    return alike


def has_corner_colours(scene: SceneMesh) -> Bools:
    """(n,) whether the colour varies over each triangle from corner to corner."""
    if scene.corner_albedo is None:
        return np.zeros(len(scene), dtype=bool)
    varies: Bools = (np.ptp(scene.corner_albedo, axis=1) > 0.0).any(axis=-1)
    return varies


def uv_planes(scene: SceneMesh, triangle: npt.NDArray[np.integer]) -> tuple[Floats, Floats]:
    """Texture coordinates of triangles' planes: (n, 2) at the origin, (n, 2, 3) gradients."""
    corners, uv = scene.corners[triangle], scene.uv[triangle]
    gradient = uv_gradients(corners, uv)
    offset = uv[:, 0] - np.einsum("nki,ni->nk", gradient, corners[:, 0])
    return offset, gradient


def _connected_components(count: int, pairs: npt.NDArray[np.intp]) -> Indices:
    """(count,) group of each element joined by (p, 2) pairs, numbered from 0."""
    label = np.arange(count)
    while True:
        smallest = label.copy()
        np.minimum.at(smallest, pairs[:, 0], label[pairs[:, 1]])
        np.minimum.at(smallest, pairs[:, 1], label[pairs[:, 0]])
        smallest = smallest[smallest]  # halves the length of chains
        if (smallest == label).all():
            break
        label = smallest
    return np.unique(label, return_inverse=True)[1].astype(np.int32)
