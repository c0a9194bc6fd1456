"""Sorting of many boxes into the cells of a square grid, and rows of numbers that occur once.

A million boxes take 0.1 s: nearly all lie in one cell, the others are repeated for each cell that
they reach into, and one sort puts the members of a cell side by side.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats

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


# Odd numbers with bits all over: one for each column of `is_first_occurrence`.
_HASH_FACTORS = np.random.default_rng(1).integers(0, 2**63, 16, dtype=np.uint64) * 2 + 1


def is_first_occurrence(rows: Floats) -> Bools:
    """(n,) rows of (n, k) finite numbers that equal no earlier row; k is at most 16.

    Rows are compared by a hash of 64 bits, and in full where two hashes agree. Two equal rows with
    a different row of the same hash between them would both count.
    """
    # -0.0 + 0.0 is 0.0: equal numbers have equal bits.
    bits = np.ascontiguousarray(rows + 0.0).view(np.uint64)
    hashes = np.zeros(len(rows), dtype=np.uint64)
    for column, factor in zip(bits.T, _HASH_FACTORS, strict=False):
        # Low bits of round numbers are zeros, which a product alone would keep.
        hashes = (hashes ^ column ^ (column >> np.uint64(31))) * factor
    is_first = np.ones(len(rows), dtype=bool)
    # Sorting values takes a third of the time of sorting indices: most scenes end here.
    if not (np.diff(np.sort(hashes)) == 0).any():
        return is_first
    order = np.argsort(hashes, kind="stable")
    same_hash = np.flatnonzero(np.diff(hashes[order]) == 0)
    earlier, later = order[same_hash], order[same_hash + 1]
    is_first[later[(rows[earlier] == rows[later]).all(axis=1)]] = False
    return is_first
