"""Obstacles of a robot's base: the scene's triangles between ankle and mirror height, from above.

A robot is a rectangle on the floor. By the separating axis theorem two convex shapes are disjoint
exactly if the normal of some edge separates them. Near triangles are found in the scene's hierarchy
and kept for all poses within the same cells of a square grid: nothing is sorted at the start, and a
robot that drives over a million triangles of 2.5 cm searches them for 8 ms every half metre.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import field, replace
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.elementary import cos, einsum, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.objects import OrientedBox
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.triangles import first_occurrences, triangle_boxes

# Obstacles lower than this are driven over: carpets, lines, sills.
GROUND_CLEARANCE_M = 0.03

# Three corners (x, y).
Triangle2D = list[list[float]]

_NO_TRIANGLES: Floats = np.zeros((0, 3, 2))


@dataclass(frozen=True, slots=True, eq=False)
class ObstacleGrid:
    """Triangles from above, searched by the cells of a square grid."""

    find_outlines: Callable[[int, int, int, int], Floats]
    """(n, 3, 2) static triangles that reach into a block of cells, by its first and last column,
    and its first and last row."""
    dynamic_triangles: Floats = field(default_factory=lambda: _NO_TRIANGLES)
    """(m, 3, 2) further triangles, in no cell."""

    def triangles_near(self, centre: tuple[float, float], radius_m: float) -> Floats:
        """(n, 3, 2) triangles that reach into a square about a point."""
        borders = [
            cell
            for coordinate in centre
            for cell in (
                math.floor((coordinate - radius_m) / _CELL_M),
                math.ceil((coordinate + radius_m) / _CELL_M),
            )
        ]
        triangles = self.find_outlines(*borders)
        if len(self.dynamic_triangles):
            triangles = np.concatenate((triangles, self.dynamic_triangles))
        if not len(triangles):
            return triangles
        # Most triangles of the same cells are out of reach, and this test is cheap.
        low, high = triangles.min(axis=1), triangles.max(axis=1)
        point = np.array(centre)
        within = ((low <= point + radius_m) & (high >= point - radius_m)).all(axis=1)
        near: Floats = triangles[within]
        return near

    def with_dynamic_triangles(self, triangles: Sequence[Floats]) -> ObstacleGrid:
        """Same obstacles with further triangles, such as footprints of robots."""
        return replace(self, dynamic_triangles=np.concatenate(triangles)) if triangles else self


def box_footprint(box: OrientedBox) -> Floats:
    """(2, 3, 2) triangles of an upright box from above."""
    half_length, half_width = 0.5 * box.size_m[0], 0.5 * box.size_m[1]
    corners = np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
    pose = box.world_from_box
    level = (
        matmul(corners * (half_length, half_width), pose.rotation[:2, :2].T) + pose.translation[:2]
    )
    return level[[[0, 1, 2], [0, 2, 3]]]


# A power of two: no product or quotient is rounded. Cells of this size are searched once, for all
# robots of a height, until as many others were.
_CELL_M, _MAX_BLOCKS = 0.5, 128


def build_obstacle_grid(scene: SceneMesh, *, low_m: float, high_m: float) -> ObstacleGrid:
    """Grid of the triangles that reach into a band of heights above the floor z = 0."""

    @lru_cache(maxsize=_MAX_BLOCKS)
    def find_outlines(left: int, right: int, near: int, far: int) -> Floats:
        low = np.array((_CELL_M * left, _CELL_M * near, -high_m))
        high = np.array((_CELL_M * right, _CELL_M * far, -low_m))
        corners = scene.corners[scene.hierarchy().find_near(low, high)]
        lows, highs = triangle_boxes(corners)
        within = (lows[2] < -low_m) & (highs[2] > -high_m)
        within &= ((lows[:2] <= high[:2, None]) & (highs[:2] >= low[:2, None])).all(axis=0)
        outlines = _clip_to_heights(corners[within], -high_m, -low_m)
        # From above many triangles of a scene are one: a third of the football field's remain.
        return outlines[first_occurrences(outlines)]

    return ObstacleGrid(find_outlines)


# Triangles of a polygon of six points.
_FAN = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]])


def _clip_to_heights(corners: Floats, low: float, high: float) -> Floats:
    """(m, 3, 2) outlines from above of what (n, 3, 3) triangles have between two z.

    Each triangle reaches into the band. A roof whose foot stands on the floor has its ridge
    elsewhere.
    """
    z = corners[..., 2]
    is_whole = ((low <= z) & (z <= high)).all(axis=1)
    starts = corners[~is_whole]
    ends = np.roll(starts, -1, axis=1)
    rises = ends[..., 2] - starts[..., 2]
    rises[rises == 0.0] = 1.0  # a level edge within the band stays
    # Both ends of each edge move along the edge into the band.
    moves = [(np.clip(at[..., 2], low, high) - at[..., 2]) / rises for at in (starts, ends)]
    shares = np.stack(moves, axis=-1)[..., None]
    points = np.stack((starts, ends), axis=2)[..., :2]
    points += shares * (ends - starts)[:, :, None, :2]
    # At most one edge lies outside: the outline goes on where the next one enters the band.
    lowest, highest = np.minimum(starts, ends)[..., 2], np.maximum(starts, ends)[..., 2]
    is_outside = (highest < low) | (lowest > high)
    points = np.where(is_outside[..., None, None], np.roll(points[:, :, :1], -1, axis=1), points)
    fans = points.reshape(-1, 6, 2)[:, _FAN].reshape(-1, 3, 2)
    has_side = (fans[:, 1] != fans[:, 2]).any(axis=1)
    return np.concatenate((corners[is_whole][..., :2], fans[has_side]))


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
    return any(
        not _has_separating_axis(along, across, half_size_m)
        for along, across in _corners_in_rectangle(triangles, centre, yaw_rad)
    )


# Both corners of each edge, and the third.
_TRIANGLE_EDGES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


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
    for i, j, k in _TRIANGLE_EDGES:
        normal = (across[j] - across[i], along[i] - along[j])
        reach = length * abs(normal[0]) + width * abs(normal[1])
        edge = along[i] * normal[0] + across[i] * normal[1]
        corner = along[k] * normal[0] + across[k] * normal[1]
        if min(edge, corner) > reach or max(edge, corner) < -reach:
            return True
    return False


def penetration_depths(
    triangles: Iterable[Triangle2D],
    centre: tuple[float, float],
    yaw_rad: float,
    *,
    half_size_m: tuple[float, float],
) -> list[float]:
    """Least translation that separates a rectangle from each of some triangles, metres.

    0 for a triangle that the rectangle does not intersect. Arguments as of `rectangle_intersects`.
    """
    return [
        _penetration_depth(along, across, half_size_m)
        for along, across in _corners_in_rectangle(triangles, centre, yaw_rad)
    ]


def _corners_in_rectangle(
    triangles: Iterable[Triangle2D], centre: tuple[float, float], yaw_rad: float
) -> Iterator[tuple[list[float], list[float]]]:
    """Yield the corners of each triangle along and across a rectangle."""
    # Plain floats: a handful of triangles is near, for which arrays take ten times as long.
    x, y = centre
    cosine, sine = cos(yaw_rad), sin(yaw_rad)
    for outline in triangles:
        along = [(u - x) * cosine + (v - y) * sine for u, v in outline]
        across = [(v - y) * cosine - (u - x) * sine for u, v in outline]
        yield along, across


def _penetration_depth(
    along: list[float], across: list[float], half_size_m: tuple[float, float]
) -> float:
    """Smallest overlap of rectangle and triangle over the axes of `_has_separating_axis`."""
    length, width = half_size_m
    # The rectangle leaves each axis by the nearer end.
    depth = min(max(along), -min(along)) + length
    depth = min(depth, min(max(across), -min(across)) + width)
    for i, j, k in _TRIANGLE_EDGES:
        normal = (across[j] - across[i], along[i] - along[j])
        norm = hypot(*normal)
        if norm > 0.0:  # an edge of no length separates nothing
            reach = length * abs(normal[0]) + width * abs(normal[1])
            edge = along[i] * normal[0] + across[i] * normal[1]
            corner = along[k] * normal[0] + across[k] * normal[1]
            depth = min(depth, (reach + min(max(edge, corner), -min(edge, corner))) / norm)
    return max(depth, 0.0)


# Triangles that many rectangles are compared with in one operation: 1300 rectangles take 13 MB.
_TRIANGLES_PER_PORTION = 128


def rectangles_intersect(
    triangles: Floats, centres: Floats, yaw_rad: float, *, half_size_m: tuple[float, float]
) -> Bools:
    """Which of many rectangles of one heading intersect any of some triangles.

    Args:
        triangles: (t, 3, 2) corners, metres, world frame.
        centres: (n, 2) centres of the rectangles, metres, world frame.
        yaw_rad: Of the rectangles' length.
        half_size_m: Half length, half width.

    Returns:
        (n,) True for a rectangle in contact.
    """
    corners, points = (_rectangle_frame(array, yaw_rad) for array in (triangles, centres))
    hit = np.zeros(len(points), dtype=bool)
    # Every portion is spread over all triangles, which lie in the order of the scene's parts: in
    # dense surroundings the first portion already meets nearly every rectangle.
    num_portions = math.ceil(len(corners) / _TRIANGLES_PER_PORTION)
    for first in range(num_portions):
        candidates = np.flatnonzero(~hit)
        if not len(candidates):
            break
        portion = corners[first::num_portions]
        hit[candidates] = _intersect_any(portion, points[candidates], half_size_m)
    return hit


def _intersect_any(corners: Floats, points: Floats, half_size_m: tuple[float, float]) -> Bools:
    """(n,) whether rectangles at (n, 2) points intersect any of (t, 3, 2) triangles."""
    # The rectangle's own directions first, for all pairs: few are left for the triangles' edges.
    low, high = corners.min(axis=1) - half_size_m, corners.max(axis=1) + half_size_m
    x, y = points[:, :1], points[:, 1:]
    near = (low[:, 0] <= x) & (x <= high[:, 0]) & (low[:, 1] <= y) & (y <= high[:, 1])
    point, triangle = np.nonzero(near)
    edges = np.roll(corners, -1, axis=1) - corners
    normals = edges[..., ::-1] * (-1.0, 1.0)
    reach = matmul(np.abs(normals), np.array(half_size_m))
    projected = matmul(normals, corners.swapaxes(1, 2))
    low, high = projected.min(axis=-1) - reach, projected.max(axis=-1) + reach
    offset = einsum("nij,nj->ni", normals[triangle], points[point])
    hit = np.zeros(len(points), dtype=bool)
    hit[point[((low[triangle] <= offset) & (offset <= high[triangle])).all(axis=-1)]] = True
    return hit


def _rectangle_frame(points: Floats, yaw_rad: float) -> Floats:
    """(..., 2) points turned from the world into the axes of a rectangle, about the origin."""
    cosine, sine = cos(yaw_rad), sin(yaw_rad)
    turned: Floats = matmul(points, np.array([[cosine, -sine], [sine, cosine]]))
    return turned
