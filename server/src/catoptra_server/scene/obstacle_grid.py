"""Obstacles of a robot's base: the scene's triangles between ankle and mirror height, from above.

A robot is a rectangle on the floor. By the separating axis theorem two convex shapes are disjoint
exactly if the normal of some edge separates them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.scene.scene_mesh import SceneMesh

# Obstacles lower than this are driven over: carpets, lines, sills.
GROUND_CLEARANCE_M = 0.03


# Cells along a side of the grid over the world: a triangle as large as the world lies in all of
# them, a robot in four.
_CELLS_PER_SIDE = 64
_MIN_CELL_M = 0.5
# Three corners (x, y).
Triangle2D = list[list[float]]

_NO_TRIANGLES: Floats = np.zeros((0, 3, 2))


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleGrid:
    """Triangles from above, in the cells of a square grid."""

    cell_m: float
    cells: Mapping[tuple[int, int], Floats]
    dynamic_triangles: Floats = field(default_factory=lambda: _NO_TRIANGLES)

    def find_near(self, centre: tuple[float, float], radius_m: float) -> list[Triangle2D]:
        """Triangles that reach into a square about a point; some occur several times."""
        columns, rows = (self._cell_range(coordinate, radius_m) for coordinate in centre)
        found = [self.cells[cell] for cell in product(columns, rows) if cell in self.cells]
        triangles = (
            np.concatenate((*found, self.dynamic_triangles)) if found else self.dynamic_triangles
        )
        if not len(triangles):
            return []
        # Most triangles of the same cells are out of reach, and this test is cheap.
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        point = np.array(centre)
        within = ((low <= point + radius_m) & (high >= point - radius_m)).all(axis=1)
        near: list[Triangle2D] = triangles[within].tolist()
        return near

    def _cell_range(self, centre_m: float, radius_m: float) -> range:
        """Columns, or rows, that an interval reaches into."""
        first = math.floor((centre_m - radius_m) / self.cell_m)
        return range(first, math.floor((centre_m + radius_m) / self.cell_m) + 1)

    def with_dynamic_triangles(self, triangles: Sequence[Floats]) -> ObstacleGrid:
        """Same obstacles with further triangles, such as footprints of robots."""
        return replace(self, dynamic_triangles=np.concatenate(triangles)) if triangles else self


def box_footprint(box: OrientedBox) -> Floats:
    """(2, 3, 2) triangles of an upright box from above."""
    half_length, half_width = 0.5 * box.size_m[0], 0.5 * box.size_m[1]
    corners = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    pose = box.world_from_box
    level = corners * (half_length, half_width) @ pose.rotation[:2, :2].T + pose.translation[:2]
    return level[[[0, 1, 2], [0, 2, 3]]]


def build_obstacle_grid(scene: SceneMesh, *, low_m: float, high_m: float) -> ObstacleGrid:
    """Grid of the triangles that reach into a band of heights above the floor z = 0."""
    heights = -scene.corners[..., 2]
    inside = (heights.max(axis=1) > low_m) & (heights.min(axis=1) < high_m)
    return _build_grid(np.ascontiguousarray(scene.corners[inside][..., :2]))


def _build_grid(corners: Floats) -> ObstacleGrid:
    """Grid of (n, 3, 2) triangles, with cells of a size that suits their extent."""
    if not len(corners):
        return ObstacleGrid(_MIN_CELL_M, {})
    extent = float(np.ptp(corners, axis=(0, 1)).max())
    cell_m = max(_MIN_CELL_M, extent / _CELLS_PER_SIDE)
    first = np.floor(corners.min(axis=1) / cell_m).astype(int).tolist()
    last = np.floor(corners.max(axis=1) / cell_m).astype(int).tolist()
    members: dict[tuple[int, int], list[int]] = {}
    for index, ((c0, r0), (c1, r1)) in enumerate(zip(first, last, strict=True)):
        for cell in product(range(c0, c1 + 1), range(r0, r1 + 1)):
            members.setdefault(cell, []).append(index)
    return ObstacleGrid(cell_m, {cell: corners[indices] for cell, indices in members.items()})


def rectangle_intersects(
    triangles: Iterable[Triangle2D],
    centre: tuple[float, float],
    yaw_rad: float,
    *,
    half_size_m: tuple[float, float],
) -> bool:
    """Whether a rectangle intersects any of some triangles.

    Args:
        centre: Of the rectangle, metres, world frame.
        yaw_rad: Of the rectangle's length.
        half_size_m: Half length, half width.
    """
    # Plain floats: a handful of triangles is near, for which arrays take ten times as long.
    x, y = centre
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    for outline in triangles:
        along = [(u - x) * cos + (v - y) * sin for u, v in outline]
        across = [(v - y) * cos - (u - x) * sin for u, v in outline]
        if not _has_separating_axis(along, across, half_size_m):
            return True
    return False


def _has_separating_axis(
    along: list[float], across: list[float], half_size_m: tuple[float, float]
) -> bool:
    """Whether the normal of a side of the rectangle or of the triangle separates the two.

    The triangle's corners are in the rectangle's axes.
    """
    length, width = half_size_m
    # The rectangle's own sides first: they separate most pairs, without a product.
    if min(along) > length or max(along) < -length or min(across) > width or max(across) < -width:
        return True
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        normal = (across[j] - across[i], along[i] - along[j])
        reach = length * abs(normal[0]) + width * abs(normal[1])
        edge = along[i] * normal[0] + across[i] * normal[1]
        corner = along[k] * normal[0] + across[k] * normal[1]
        if min(edge, corner) > reach or max(edge, corner) < -reach:
            return True
    return False
