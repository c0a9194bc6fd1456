"""Sorting of many boxes into the cells of a square grid, and rows of numbers that occur once.

A million boxes take 0.1 s: nearly all lie in one cell, the others are repeated for each cell that
they reach into, and one sort puts the members of a cell side by side.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene.row_blocks import row_blocks, sorted_rows

Indices = npt.NDArray[np.intp]
Cell = tuple[int, int]


def cell_members(low: Floats, high: Floats, cell_m: float) -> dict[Cell, Indices]:
    """Boxes that reach into each cell of a grid.

    Args:
        low: (2, n) smallest coordinates of each box, n at least 1.
        high: (2, n) largest coordinates.
        cell_m: side of a cell; cell (0, 0) begins at the origin.

    Returns:
        Indices of the boxes by cell; no entry for a cell without any.
    """
    first, last = (np.floor(edge / cell_m).astype(np.int32) for edge in (low, high))
    origin = first.min(axis=1)
    num_rows = int(last[1].max() - origin[1]) + 1
    keys = (first[0] - origin[0]) * num_rows + (first[1] - origin[1])
    boxes, offsets = _further_cells(first, last, num_rows)
    keys = np.concatenate((keys, keys[boxes] + offsets))
    # Whole numbers of 16 bits are sorted by counting, five times as fast.
    order = np.argsort(keys.astype(np.int16) if keys.max() < 2**15 else keys, kind="stable")
    sorted_keys = keys[order]
    starts = np.flatnonzero(np.diff(sorted_keys, prepend=-1))
    members = np.split(np.concatenate((np.arange(len(low.T)), boxes))[order], starts[1:])
    columns, rows = np.divmod(sorted_keys[starts], num_rows) + origin[:, None]
    return dict(zip(zip(columns.tolist(), rows.tolist(), strict=True), members, strict=True))


def _further_cells(
    first: npt.NDArray[np.int32], last: npt.NDArray[np.int32], num_rows: int
) -> tuple[Indices, Indices]:
    """Index of the box, and distance of keys from its first cell, for each further cell of a box.

    Args:
        first: (2, n) first column and row of each box.
        last: (2, n) last column and row.
        num_rows: Distance of the keys of two columns.
    """
    several = np.flatnonzero((first != last).any(axis=0))
    columns, rows = last[:, several] - first[:, several] + 1
    counts = columns.astype(np.intp) * rows - 1
    # 1 to `counts` for each box: positions among its cells, column by column.
    position = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    column, row = np.divmod(position, np.repeat(rows, counts))
    return np.repeat(several, counts), column * num_rows + row


# Odd numbers with bits all over: one for each number of a row of `first_occurrences`.
_HASH_FACTORS = np.random.default_rng(1).integers(0, 2**63, 16, dtype=np.uint64) * 2 + 1


def first_occurrences(values: Floats, rows: Indices) -> Indices:
    """Those of some rows that equal no earlier one of them.

    Rows are compared by a hash of 64 bits, and in full where two hashes agree. Two equal rows with
    a different row of the same hash between them would both count.

    Args:
        values: (n, ...) finite numbers, at most 16 a row.
        rows: Indices of the rows that are compared, ascending.
    """
    hashes = np.zeros(len(rows), dtype=np.uint64)
    for block in row_blocks(len(rows)):
        hashes[block] = _hash_rows(sorted_rows(values, rows[block]))
    # Sorting values takes a third of the time of sorting indices: most scenes end here.
    if not _has_equal_neighbours(np.sort(hashes)).any():
        return rows
    order = np.argsort(hashes, kind="stable")
    same_hash = np.flatnonzero(_has_equal_neighbours(hashes[order]))
    earlier, later = rows[order[same_hash]], order[same_hash + 1]
    is_equal = values[earlier] == values[rows[later]]
    is_first = np.ones(len(rows), dtype=bool)
    is_first[later[is_equal.reshape(len(later), -1).all(axis=1)]] = False
    return rows[is_first]


def _hash_rows(values: Floats) -> npt.NDArray[np.uint64]:
    """(n,) hashes of (n, ...) numbers; those of equal rows are equal."""
    columns = np.ascontiguousarray(np.moveaxis(values, 0, -1)).reshape(-1, len(values))
    hashes = np.zeros(len(values), dtype=np.uint64)
    # -0.0 + 0.0 is 0.0: equal numbers have equal bits.
    for column, factor in zip((columns + 0.0).view(np.uint64), _HASH_FACTORS, strict=False):
        # Low bits of round numbers are zeros, which a product alone would keep.
        hashes = (hashes ^ column ^ (column >> np.uint64(31))) * factor
    return hashes


def _has_equal_neighbours(values: npt.NDArray[np.uint64]) -> Bools:
    """(n - 1,) whether each value equals the next one."""
    is_equal: Bools = values[1:] == values[:-1]
    return is_equal
