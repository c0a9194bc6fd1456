"""Cells of an image that the bounding spheres of clusters of small triangles may cover.

Each sphere's rectangle of cells is added to a table of differences; two running sums mark all
rectangles at once, however large they are.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.cells import CellGrid
from catoptra_server.render.trace.projection_table import MAX_PIXEL_ERROR_PX, ProjectionTable


def covered_cells(
    centre: Floats, radius_m: Floats, *, pose: Pose, table: ProjectionTable, grid: CellGrid
) -> Bools:
    """(rows * columns,) whether any of k spheres, world frame, may cover each cell."""
    towards = (centre - pose.translation) @ pose.rotation
    distance = np.linalg.norm(towards, axis=-1)
    if (distance <= radius_m).any():
        return np.ones(grid.rows * grid.columns, dtype=bool)
    unit = towards / distance[:, None]
    reach = np.arcsin(radius_m / distance)
    incidence = np.arccos(np.clip(unit[:, 2], -1.0, 1.0))
    seen = np.flatnonzero(incidence - reach <= table.rim_rad)
    unit, reach, incidence = unit[seen], reach[seen], incidence[seen]
    # A centre beyond the rim is moved to the rim: no direction of the sphere that the mirror sees
    # is farther than twice the sphere's reach from there.
    beyond = incidence > table.rim_rad
    unit[beyond] = _at_incidence(unit[beyond], table.rim_rad)
    reach[beyond] *= 2.0
    reach_px = reach * table.max_pixels_per_radian(incidence + reach) + MAX_PIXEL_ERROR_PX
    u, v = table.pixel_from_direction(*unit.T.astype(np.float32))
    return _rectangles(u.astype(float), v.astype(float), reach_px, grid)


def _at_incidence(unit: Floats, incidence_rad: float) -> Floats:
    """(n, 3) directions of the same azimuths at an incidence angle."""
    level = unit[:, :2] / np.maximum(np.linalg.norm(unit[:, :2], axis=-1, keepdims=True), 1e-12)
    height = np.full((len(unit), 1), math.cos(incidence_rad))
    return np.hstack((math.sin(incidence_rad) * level, height))


def _rectangles(u: Floats, v: Floats, reach_px: Floats, grid: CellGrid) -> Bools:
    """Cells that squares of half side `reach_px` around pixels touch."""
    left, right = _span(u, reach_px, grid.side_px, grid.columns)
    top, bottom = _span(v, reach_px, grid.side_px, grid.rows)
    change = np.zeros((grid.rows + 1, grid.columns + 1), dtype=np.int32)
    for row, column, by in ((top, left, 1), (top, right, -1), (bottom, left, -1)):
        np.add.at(change, (row, column), by)
    np.add.at(change, (bottom, right), 1)
    covered: Bools = change.cumsum(axis=0).cumsum(axis=1)[:-1, :-1].reshape(-1) > 0
    return covered


def _span(
    at: Floats, reach_px: Floats, side_px: int, count: int
) -> tuple[np.ndarray[tuple[int]], np.ndarray[tuple[int]]]:
    """First cell and one past the last that intervals touch, within 0..count."""
    first = np.clip((at - reach_px) / side_px, 0.0, count).astype(np.int64)
    after = np.clip(np.floor((at + reach_px) / side_px) + 1.0, 0.0, count).astype(np.int64)
    return first, np.maximum(after, first)
