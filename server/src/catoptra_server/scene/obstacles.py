"""What a robot bumps into: the scene's triangles between ankle and mirror height, seen from above.

A robot is a rectangle on the floor. Two convex shapes are apart iff some edge normal separates
them, which is tested for all near triangles at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene.meshes import SceneMesh
from catoptra_server.scene.oriented_box import OrientedBox

# Things lower than this are driven over: carpets, lines, sills.
CLEARANCE_M = 0.03


# Cells a side of the grid over the world: a triangle as large as the world lies in all of them,
# a robot in four.
_CELLS = 64
_SMALLEST_CELL_M = 0.5
_NONE: Floats = np.zeros((0, 3, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Obstacles:
    """Triangles from above, (n, 3, 2) in metres, world frame, by the cells of a square grid.

    cells: for each cell (column, row) that has any, the triangles whose bounds reach into it.
    moving: (m, 3, 2) more of them, few, which the next tick has elsewhere: other robots near by.
    """

    cell_m: float
    cells: Mapping[tuple[int, int], Floats]
    moving: Floats = field(default_factory=lambda: _NONE)

    def near(self, centre: Floats, radius_m: float) -> Floats:
        """Return the (m, 3, 2) triangles around a circle; one may come more than once."""
        found = [
            self.cells[cell]
            for cell in product(*(self._cells_along(float(c), radius_m) for c in centre))
            if cell in self.cells
        ]
        return np.concatenate((*found, self.moving)) if found else self.moving

    def _cells_along(self, middle_m: float, radius_m: float) -> range:
        """Return the columns, or rows, that an interval reaches into."""
        first = math.floor((middle_m - radius_m) / self.cell_m)
        return range(first, math.floor((middle_m + radius_m) / self.cell_m) + 1)

    def with_outlines(self, outlines: Sequence[Floats]) -> Obstacles:
        """Return these obstacles and, beside them, outlines of upright boxes."""
        return replace(self, moving=np.concatenate(outlines)) if outlines else self


def box_outline(box: OrientedBox) -> Floats:
    """Return the (2, 3, 2) triangles of an upright box from above."""
    half_length, half_width = 0.5 * box.size_m[0], 0.5 * box.size_m[1]
    corners = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    pose = box.world_from_box
    level = corners * (half_length, half_width) @ pose.rotation[:2, :2].T + pose.translation[:2]
    return level[[[0, 1, 2], [0, 2, 3]]]


def obstacles_between(scene: SceneMesh, *, low_m: float, high_m: float) -> Obstacles:
    """Return the triangles that reach into a band of heights above the floor z = 0."""
    heights = -scene.corners[..., 2]
    inside = (heights.max(axis=1) > low_m) & (heights.min(axis=1) < high_m)
    return _sorted_into_cells(np.ascontiguousarray(scene.corners[inside][..., :2]))


def _sorted_into_cells(corners: Floats) -> Obstacles:
    """Return (n, 3, 2) triangles by cells of a size that suits their extent."""
    if not len(corners):
        return Obstacles(_SMALLEST_CELL_M, {})
    extent = float(np.ptp(corners, axis=(0, 1)).max())
    cell_m = max(_SMALLEST_CELL_M, extent / _CELLS)
    first = np.floor(corners.min(axis=1) / cell_m).astype(int).tolist()
    last = np.floor(corners.max(axis=1) / cell_m).astype(int).tolist()
    members: dict[tuple[int, int], list[int]] = {}
    for index, ((c0, r0), (c1, r1)) in enumerate(zip(first, last, strict=True)):
        for cell in product(range(c0, c1 + 1), range(r0, r1 + 1)):
            members.setdefault(cell, []).append(index)
    return Obstacles(cell_m, {cell: corners[indices] for cell, indices in members.items()})


def rectangle_touches(
    obstacles: Obstacles, centre: Floats, yaw_rad: float, *, half_size_m: tuple[float, float]
) -> bool:
    """Return whether a rectangle (half length, half width) at (2,), turned, meets a triangle."""
    reach_m = math.hypot(*half_size_m)
    triangles = _within(obstacles.near(centre, reach_m) - centre, reach_m)
    if not len(triangles):
        return False
    forward = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    left = np.array([forward[1], -forward[0]])
    halves = np.stack((half_size_m[0] * forward, half_size_m[1] * left))
    edges = np.roll(triangles, -1, axis=1) - triangles
    normals = np.stack((edges[..., 1], -edges[..., 0]), axis=-1)
    own = np.broadcast_to(halves, (len(triangles), 2, 2))
    apart = _apart(triangles, np.concatenate((own, normals), axis=1), halves)
    return bool((~apart).any())


def _within(triangles: Floats, reach_m: float) -> Floats:
    """Return those of (n, 3, 2) triangles whose bounds reach into a square about 0.

    Most of what lies in the same cells does not, and telling so costs a fifth of parting it.
    """
    if not len(triangles):
        return triangles
    beside = (triangles.min(axis=1) > reach_m) | (triangles.max(axis=1) < -reach_m)
    within: Floats = triangles[~beside.any(axis=1)]
    return within


def _apart(triangles: Floats, axes: Floats, halves: Floats) -> Bools:
    """Return (n,) whether one of (n, k, 2) axes parts (n, 3, 2) triangles from the rectangle."""
    along = np.einsum("nci,nki->nkc", triangles, axes)
    reach = np.abs(axes @ halves.T).sum(axis=-1)
    separated: Bools = ((along.min(axis=-1) > reach) | (along.max(axis=-1) < -reach)).any(axis=-1)
    return separated
