"""From the factors of nodes to the bytes of an atlas: nodes inside solids filled, rays' sets mixed.

Neighbouring nodes use different sets of directions, in squares of two by two. A tent over three by
three nodes weighs all four sets alike, so steps at the edges of occluders vanish; grids of fewer
than four nodes along a side are left as they are in that direction.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.trace.occlusion.grid_layout import GridLayout
from catoptra_server.world.occlusion_map import OPEN

# Rows of nodes inside a solid that the filter or an interpolation near a visible node reaches.
_NUM_FILLED = 2
_MIN_FILTERED = 4
_DIRECTIONS = [(dy, dx) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if dy or dx]


def filter_factors(
    layout: GridLayout, near: Bools, factors: Floats, inside: Bools
) -> npt.NDArray[np.uint8]:
    """(h, w) atlas of the factors of the nodes that are near casters, in their order; else open.

    Args:
        layout: Places of the grids.
        near: (h, w) nodes that were measured.
        factors: (k,) factors of these.
        inside: (k,) nodes inside solids.
    """
    values, known = np.ones(near.shape), np.ones(near.shape, dtype=bool)
    values[near], known[near] = factors, ~inside
    grid = layout.grid_at()
    values = _fill(values, known, grid)
    values = _blur(values, grid, axis=1, is_filtered=layout.columns >= _MIN_FILTERED)
    values = _blur(values, grid, axis=0, is_filtered=layout.rows >= _MIN_FILTERED)
    return np.round(values * OPEN).astype(np.uint8)


def _fill(values: Floats, known: Bools, grid: npt.NDArray[np.int32]) -> Floats:
    """Values with those of unknown nodes continued from known nodes of the grid, else 1."""
    for _ in range(_NUM_FILLED):
        row, column = np.nonzero(~known)
        total, count = np.zeros(len(row)), np.zeros(len(row))
        for dy, dx in _DIRECTIONS:
            near, is_near = _look(values, known, grid, (row, column), (dy, dx))
            far, is_far = _look(values, known, grid, (row, column), (2 * dy, 2 * dx))
            # Along a straight line: factors fall towards the foot of a wall.
            continued = np.clip(np.where(is_far, 2.0 * near - far, near), 0.0, 1.0)
            total += np.where(is_near, continued, 0.0)
            count += is_near
        filled = count > 0.0
        values, known = values.copy(), known.copy()
        values[row[filled], column[filled]] = total[filled] / count[filled]
        known[row[filled], column[filled]] = True
    return np.where(known, values, 1.0)


def _look(
    values: Floats,
    known: Bools,
    grid: npt.NDArray[np.int32],
    at: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]],
    step: tuple[int, int],
) -> tuple[Floats, Bools]:
    """(k,) values a step away from nodes, and whether they are known and of the same grid."""
    y, x = (index + offset for index, offset in zip(at, step, strict=True))
    inside = (y >= 0) & (y < grid.shape[0]) & (x >= 0) & (x < grid.shape[1])
    y, x = np.where(inside, y, 0), np.where(inside, x, 0)
    return values[y, x], inside & known[y, x] & (grid[y, x] == grid[at])


def _blur(values: Floats, grid: npt.NDArray[np.int32], *, axis: int, is_filtered: Bools) -> Floats:
    """Tent over three nodes along an axis of the grids; the outermost nodes count twice."""
    before, after = _shift(values, grid, axis, 1), _shift(values, grid, axis, -1)
    # The last entry is that of nodes without a grid.
    is_kept = ~np.append(is_filtered, False)[grid]
    return np.where(is_kept, values, 0.25 * (before + after) + 0.5 * values)


def _shift(values: Floats, grid: npt.NDArray[np.int32], axis: int, step: int) -> Floats:
    """Values of the nodes a step before each; its own where that is not of the same grid."""
    is_same = np.roll(grid, step, axis=axis) == grid
    # Rolled round from the other border: a grid as wide as the atlas would meet itself.
    border = [slice(None), slice(None)]
    border[axis] = slice(0, 1) if step > 0 else slice(-1, None)
    is_same[tuple(border)] = False
    return np.where(is_same, np.roll(values, step, axis=axis), values)
