"""Cells of an image that silhouette edges cross in front of the surface seen there.

The proof that a cell may be filled. Let its four corner rays hit surface T. The pyramid that these
rays span meets T's plane in a quadrilateral with corners on T; T has no edge inside, or the edge
would have been found, so the whole quadrilateral is on T. Let another plane surface O occlude a
part of T. The directions of the pyramid for which O's plane is nearer than T's are cut off by one
straight line, so these directions contain a corner ray, or are none. If no edge of O crosses there
in front of T, O covers all of these directions or none; not all, since the corner rays hit T. So O
occludes nothing. Curved objects are many surfaces; triangles too small for edges of their own lie
in a sphere that marks every cell which the triangles may cover. The proof does not hold for two
coincident surfaces, where rays too show now one, now the other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.packed_light import Float32s
from catoptra_server.render.trace.projection_table import MAX_PIXEL_ERROR_PX, ProjectionTable

# Depth behind a surface from which the surface occludes an edge, relative to the edge's distance:
# the rounding of float32 stays within, for grazing surfaces too (see visible_surfaces). Also
# relative to the distance of the near end, from which all distances along the edge are computed.
_BEHIND = np.float32(3e-4)
_BEHIND_NEAR_END = np.float32(1e-6)
# Edges nearer to the viewpoint than this, relative to their length, pass through the viewpoint.
_MIN_LENGTH = 1e-12


class SilhouetteEdges:
    """A part of a scene's silhouette edges, to be followed through a camera's image."""

    def __init__(self, ends: Floats, table: ProjectionTable, grid: CellGrid) -> None:
        """Keep (e, 2, 3) ends in the world frame."""
        self._ends = ends
        self._table = table
        self._grid = grid

    def find_cells(self, pose: Pose, cell_vectors: Float32s) -> npt.NDArray[np.int32]:
        """Cells that an edge crosses in front of the plane seen there; cells may repeat.

        cell_vectors: (rows * columns, 3) inverse distances of planes, mirror frame; zeros are
        infinitely far.
        """
        bearing, inverse, ends = self._sample_arcs(pose)
        u, v = self._table.pixel_from_direction(*bearing)
        cells = []
        for touched, valid in self._rasterize_steps(u, v, ends):
            which = np.flatnonzero(valid)
            cell = touched.take(which)
            vectors = cell_vectors.take(cell, axis=0)
            front = _is_in_front(vectors, bearing, inverse, which)
            front |= _is_in_front(vectors, bearing, inverse, which + 1)
            cells.append(cell[front])
        return np.concatenate(cells)

    def _sample_arcs(
        self, pose: Pose
    ) -> tuple[tuple[Float32s, Float32s, Float32s], Float32s, Bools]:
        """Points along the edges: directions, greatest 1 / distance, and ends of edges."""
        start, across, angle, density = self._visible_arcs(pose)
        steps = np.ceil(angle * density).astype(np.int64) + 1
        last = np.cumsum(steps) - 1
        line = np.repeat(np.arange(len(steps)), steps)
        along = np.arange(len(line)) - np.repeat(last + 1 - steps, steps)
        phi = (along * (angle / np.maximum(steps - 1, 1)).take(line)).astype(np.float32)
        c, s = np.cos(phi), np.sin(phi)
        # 1 / distance is linear in cos and sin of the angle along the arc, as the three
        # coordinates are.
        x, y, z, inverse = (start[i].take(line) * c + across[i].take(line) * s for i in range(4))
        inverse += _BEHIND * inverse + _BEHIND_NEAR_END * start[3].take(line)
        is_last = np.zeros(len(line), dtype=bool)
        is_last[last] = True
        return (x, y, z), inverse, is_last

    def _visible_arcs(self, pose: Pose) -> tuple[Float32s, Float32s, Floats, Floats]:
        """Great-circle arcs of all edges that the mirror may see.

        Returns:
            Unit directions and 1 / distance as factors of the cosine and of the sine of the angle
                along each arc, (4, n) each; (n,) angles; (n,) steps per radian, so that no step
                skips a row of cells.
        """
        ends = (self._ends - pose.translation) @ pose.rotation
        distance = np.maximum(np.linalg.norm(ends, axis=-1), _MIN_LENGTH)
        unit = ends / distance[..., None]
        a, b = unit[:, 0], unit[:, 1]
        cosine = np.einsum("ei,ei->e", a, b)
        across = b - cosine[:, None] * a
        sine = np.maximum(np.linalg.norm(across, axis=-1), _MIN_LENGTH)
        angle = np.arctan2(sine, cosine)
        incidence = np.arccos(np.clip(unit[..., 2], -1.0, 1.0))
        near = np.flatnonzero(incidence.min(axis=1) - 0.5 * angle < self._table.rim_rad + 0.01)
        highest = incidence.max(axis=1)[near] + 0.5 * angle[near]
        step_px = self._grid.side_px - 3.0 * MAX_PIXEL_ERROR_PX
        density = self._table.max_pixels_per_radian(highest) / step_px
        slope = (1.0 / distance[:, 1] - cosine / distance[:, 0]) / sine
        start = np.column_stack((a, 1.0 / distance[:, 0]))[near]
        turned = np.column_stack((across / sine[:, None], slope))[near]
        return (
            np.ascontiguousarray(start.T, dtype=np.float32),
            np.ascontiguousarray(turned.T, dtype=np.float32),
            angle[near],
            density,
        )

    def _rasterize_steps(
        self, u: Float32s, v: Float32s, is_last: Bools
    ) -> list[tuple[npt.NDArray[np.int32], Bools]]:
        """Four times (n - 1,) cells around the steps between points, and which are new."""
        left, right = self._cells_between(u, self._grid.columns)
        top, bottom = self._cells_between(v, self._grid.rows)
        inside = ~is_last[:-1]
        inside &= (right >= 0) & (left < self._grid.columns)
        inside &= (bottom >= 0) & (top < self._grid.rows)
        columns = self._grid.columns
        left, right = np.maximum(left, 0), np.minimum(right, columns - 1)
        top, bottom = np.maximum(top, 0), np.minimum(bottom, self._grid.rows - 1)
        wide, tall = inside & (right != left), inside & (bottom != top)
        both = wide & tall
        return [
            (top * columns + left, inside),
            (top * columns + right, wide),
            (bottom * columns + left, tall),
            (bottom * columns + right, both),
        ]

    def _cells_between(
        self, at: Float32s, count: int
    ) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        """First and last cell column (or row) of each step, clipped to -1..count."""
        side = np.float32(self._grid.side_px)
        margin = np.float32(MAX_PIXEL_ERROR_PX)
        low = np.minimum(at[1:], at[:-1])
        high = np.maximum(at[1:], at[:-1])
        first = np.clip((low - margin) / side, -1.0, count)
        last = np.clip((high + margin) / side, -1.0, count)
        return np.floor(first).astype(np.int32), np.floor(last).astype(np.int32)


def _is_in_front(
    vectors: Float32s,
    bearing: tuple[Float32s, Float32s, Float32s],
    inverse: Float32s,
    indices: npt.NDArray[np.intp],
) -> Bools:
    """Whether points lie in front of planes, or on them."""
    x, y, z = bearing
    depth = vectors[:, 0] * x.take(indices)
    depth += vectors[:, 1] * y.take(indices)
    depth += vectors[:, 2] * z.take(indices)
    nearer: Bools = depth <= inverse.take(indices)
    return nearer
