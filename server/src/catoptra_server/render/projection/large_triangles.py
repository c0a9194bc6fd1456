"""Triangles that are large for their distance, in pieces around the viewpoint.

A rasterizer's float32 arithmetic and clipping err by a part of a triangle's size, which is a wide
angle where a large triangle passes near the viewpoint. Such triangles are split in float64. An edge
is split by its own length and distance alone, so triangles that share an edge split it at the same
points, and no crack opens. A triangle that is near while its edges are far gets a corner at the
foot of the perpendicular from the viewpoint. Pieces grow with their distance: their number grows
with the logarithm of size over distance.

Pieces hold for all viewpoints of a cell of a fixed grid, so a frame follows from its camera state
alone. In ordinary worlds nothing is split.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.elementary import dot
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.bounds.coordinate_rounding import POINT_M, ViewpointCells
from catoptra_server.world.triangles import (
    Indices,
    TriangleClusters,
    triangle_distances,
    visible_runs,
)

MAX_SIZE_PER_DISTANCE = 128.0
"""Length over distance that no edge exceeds: 0.3 m above a floor, edges of 38 m. In llvmpipe errors
are proportional to this ratio up to a thousand at least; at ten thousand whole parts are missing
(tests/server/render/test_scene_rounding.py)."""
# Depth of the near plane in glsl/face.vert: nothing is seen at a smaller distance.
_NEAR_M = 0.001
_CELL_SIDES_M = (0.5, 0.125, 1.0 / 32.0, 1.0 / 128.0)
# Half a cell's diagonal over the distance of any triangle that is split.
_MAX_CELL_LOSS = 1.0 / 3.0
# Place of the cut on the half of an edge whose end is nearest: the longer piece is 63 times as long
# as it is far, or 95 times from elsewhere in the cell.
_MAX_CUT = 31.0 / 32.0
# Of a corner, where the foot of the perpendicular is inside a triangle and not, but for rounding,
# on an edge.
_MIN_WEIGHT = 1e-6
# A triangle that is a line but for rounding has no inside.
_MIN_SQUARED_SINE = 1e-26
# Edges of 200 km that pass at a millimetre take a third of these.
_MAX_ROUNDS = 64


@dataclass(frozen=True, slots=True, eq=False)
class TrianglePieces:
    """Pieces to draw in place of triangles, by positions in the order of the clusters."""

    replaced: Indices
    """(k,) positions of the triangles, ascending."""
    parents: Indices
    """(m,) position of each piece's triangle, ascending."""
    corners: Floats
    """(m, 3, 3)."""
    weights: Floats
    """(m, 3, 3) weights of the triangle's three corners in each corner of a piece."""

    def runs(self, visible: Bools, offsets: Indices, first_piece: int) -> list[tuple[int, int]]:
        """(first, count) positions of the triangles and pieces to draw.

        Args:
            visible: (c,) whether each of some consecutive clusters is visible.
            offsets: (c + 1,) positions at which these begin, and their end.
            first_piece: Position at which the pieces of all clusters begin.
        """
        runs = visible_runs(visible, offsets)
        if not runs or not len(self.replaced):
            return runs
        parts = [part for first, count in runs for part in self._cut(first, first + count)]
        first, end = np.searchsorted(self.parents, (offsets[0], offsets[-1])).tolist()
        return [*parts, (first_piece + first, end - first)] if end > first else parts

    def _cut(self, first: int, end: int) -> list[tuple[int, int]]:
        """(first, count) positions of what is left of a run."""
        inner = self.replaced[slice(*np.searchsorted(self.replaced, (first, end)))].tolist()
        ends = zip((first, *(position + 1 for position in inner)), (*inner, end), strict=True)
        return [(start, stop - start) for start, stop in ends if stop > start]


_NO_PIECES = TrianglePieces(
    np.zeros(0, dtype=np.intp),
    np.zeros(0, dtype=np.intp),
    np.zeros((0, 3, 3)),
    np.zeros((0, 3, 3)),
)
_Cell = tuple[Indices, Floats, float]  # positions of large triangles, centre, half the diagonal


class LargeTriangles:
    """Large triangles of one mesh, and their pieces around the last viewpoint."""

    def __init__(self, clusters: TriangleClusters, corners: Floats) -> None:
        """Keep (n, 3, 3) corners, in the order of the mesh."""
        self._clusters = clusters
        self._corners = corners
        self._diagonals = np.linalg.norm(clusters.box_max - clusters.box_min, axis=-1)
        self._cells = ViewpointCells(_CELL_SIDES_M, self._find_in_cell)
        self._cell: _Cell | None = None
        self._pieces = _NO_PIECES

    def split(self, viewpoint: Floats) -> TrianglePieces:
        """Pieces around a (3,) viewpoint: the last ones, the same object, while they hold."""
        cell = self._cells.find(viewpoint)
        if cell is not self._cell:
            self._cell = cell
            self._pieces = self._make_pieces(*cell)
        return self._pieces

    def replace(self, viewpoint: Floats) -> tuple[Floats, Indices, Floats]:
        """(m, 3, 3) corners of all triangles or their pieces, and their (m,) triangles.

        Last, (m, 3, 3) weights of the triangle's corners in each of these corners.
        """
        pieces, order = self.split(viewpoint), self._clusters.order
        if pieces is _NO_PIECES:
            whole = np.broadcast_to(np.eye(3), self._corners.shape)
            return self._corners, np.arange(len(self._corners)), whole
        kept = np.delete(order, pieces.replaced)
        corners = np.concatenate((self._corners[kept], pieces.corners))
        weights = np.concatenate((np.broadcast_to(np.eye(3), (len(kept), 3, 3)), pieces.weights))
        return corners, np.concatenate((kept, order[pieces.parents])), weights

    def _find_in_cell(self, centre: Floats, sides: Floats) -> _Cell | None:
        """Large triangles of a cell; None for a cell too large for its surroundings."""
        reach_m = 0.5 * float(np.linalg.norm(sides))
        clusters, offsets = self._clusters, self._clusters.offsets
        # No edge is longer than the diagonal of its cluster's box.
        near = np.flatnonzero(_is_large(self._diagonals, clusters.distances(centre) - reach_m))
        members = [np.arange(offsets[index], offsets[index + 1]) for index in near]
        positions = np.concatenate((_NO_PIECES.replaced, *members))
        corners = self._corners[clusters.order[positions]]
        sizes = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
        distances = triangle_distances(centre, corners)
        # A little smaller for the rounding: every triangle that shares a split edge is large.
        is_large = _is_large(sizes, (1.0 - 1e-9) * distances - reach_m)
        nearest_m = distances[is_large].min(initial=np.inf)
        if reach_m > _MAX_CELL_LOSS * nearest_m and sides[0] > POINT_M:
            return None
        return positions[is_large], centre, reach_m

    def _make_pieces(self, positions: Indices, centre: Floats, reach_m: float) -> TrianglePieces:
        if not len(positions):
            return _NO_PIECES
        corners = self._corners[self._clusters.order[positions]]
        parents, rows = _split(corners, centre, reach_m)
        return TrianglePieces(positions, positions[parents], rows[..., :3], rows[..., 3:])


def _is_large(sizes: Floats, distances: Floats) -> Bools:
    large: Bools = sizes > MAX_SIZE_PER_DISTANCE * np.maximum(distances, _NEAR_M)
    return large


def _split(corners: Floats, viewpoint: Floats, reach_m: float) -> tuple[Indices, Floats]:
    """Split triangles until none is large for its distance.

    Args:
        corners: (n, 3, 3).
        viewpoint: (3,) centre of the cell.
        reach_m: Half the cell's diagonal.

    Returns:
        (m,) triangle of each piece, ascending; (m, 3, 6) position and weights of its corners.
    """
    rows = np.concatenate((corners, np.broadcast_to(np.eye(3), corners.shape)), axis=-1)
    parents = np.arange(len(rows))
    done = []
    for _ in range(_MAX_ROUNDS):
        sizes, distances, cuts = _measure_edges(rows[..., :3] - viewpoint)
        weights, heights = _perpendicular_foot(rows[..., :3] - viewpoint)
        is_long = _is_large(sizes, distances - reach_m)
        has_foot = (weights > _MIN_WEIGHT).all(axis=1)
        has_foot &= _is_large(sizes.max(axis=1), heights - reach_m)
        is_cut = is_long.any(axis=1) & ~has_foot
        is_done = ~(is_cut | has_foot)
        done.append((parents[is_done], rows[is_done]))
        if is_done.all():
            break
        # The longest first: its pieces are the least narrow. The order of cuts moves none.
        longest = np.where(is_long, sizes, 0.0)[is_cut].argmax(axis=1)
        halves = _cut_edges(rows[is_cut], longest, cuts[is_cut])
        feet = np.einsum("nk,nki->ni", weights[has_foot], rows[has_foot])[:, None]
        corners_of_fan = np.eye(3, dtype=bool)[..., None]
        fan = [np.where(corner, feet, rows[has_foot]) for corner in corners_of_fan]
        rows = np.concatenate((*halves, *fan))
        parents = np.concatenate((*[parents[is_cut]] * 2, *[parents[has_foot]] * 3))
    else:
        done.append((parents, rows))
    parents = np.concatenate([first for first, _ in done])
    order = np.argsort(parents, kind="stable")
    return parents[order], np.concatenate([second for _, second in done])[order]


def _measure_edges(corners: Floats) -> tuple[Floats, Floats, Floats]:
    """(n, 3) lengths and distances of edges, and where to cut them.

    Edges begin at their index. Cuts are in half lengths from the middle. An edge from the other
    end has the same numbers, bit for bit, but for the sign of the cut.

    Args:
        corners: (n, 3, 3) corners around the viewpoint.
    """
    following = np.roll(corners, -1, axis=1)
    half, middle = 0.5 * (following - corners), 0.5 * (corners + following)
    square = dot(half, half)
    nearest = np.clip(-dot(middle, half) / np.where(square > 0.0, square, 1.0), -1.0, 1.0)
    offset = middle + nearest[..., None] * half
    cuts = np.clip(nearest, -_MAX_CUT, _MAX_CUT)
    return 2.0 * np.sqrt(square), np.sqrt(dot(offset, offset)), cuts


def _perpendicular_foot(corners: Floats) -> tuple[Floats, Floats]:
    """(n, 3) weights of the foot of the perpendicular from the viewpoint, and its (n,) lengths.

    Args:
        corners: (n, 3, 3) corners around the viewpoint.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    square = dot(normal, normal)
    sides = dot(b - a, b - a) * dot(c - a, c - a)
    square = np.where(square > _MIN_SQUARED_SINE * sides, square, np.inf)
    products = [dot(np.cross(*pair), normal) for pair in ((b, c), (c, a), (a, b))]
    return np.stack(products, axis=1) / square[:, None], np.abs(dot(a, normal)) / np.sqrt(square)


def _cut_edges(rows: Floats, edges: Indices, cuts: Floats) -> tuple[Floats, Floats]:
    """Both parts of (n, 3, 6) triangles, each cut through one of its edges."""
    index = np.arange(len(rows))
    first, second = rows[index, edges], rows[index, (edges + 1) % 3]
    cut = 0.5 * (first + second) + cuts[index, edges][:, None] * (0.5 * (second - first))
    one, other = rows.copy(), rows.copy()
    one[index, (edges + 1) % 3] = cut
    other[index, edges] = cut
    return one, other
