"""Blocks of rows for arithmetic on long arrays.

An expression over a million triangles writes every intermediate result to memory, and reads it
back. In blocks the intermediate results stay in the processor's cache: normals of a million
triangles take 42 ms in place of 300, bounds of their radiance a quarter of the time.
"""

from __future__ import annotations

from collections.abc import Iterator

from catoptra_protocol.optics.numerics import Bools, Floats

# 4096 to 65 536 rows take about as long: 600 KiB of corners at 8192, the size of a level 2 cache.
ROWS_PER_BLOCK = 8192


def row_blocks(num_rows: int) -> Iterator[slice]:
    """Yield slices that cover all rows, in order."""
    for first in range(0, num_rows, ROWS_PER_BLOCK):
        yield slice(first, min(first + ROWS_PER_BLOCK, num_rows))


def select_rows(values: Floats, mask: Bools) -> Floats:
    """Rows of a (n,) mask; the array itself where the mask has all."""
    return values if mask.all() else values[mask]
