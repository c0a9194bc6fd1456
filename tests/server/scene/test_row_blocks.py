"""Blocks of rows: all rows once, in order, none longer than a block."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.triangles import (
    ROWS_PER_BLOCK,
    gather_rows,
    row_blocks,
    select_rows,
    sorted_rows,
)


@pytest.mark.parametrize("count", [0, 1, ROWS_PER_BLOCK, ROWS_PER_BLOCK + 1, 3 * ROWS_PER_BLOCK])
def test_blocks_cover_all_rows_once(count: int) -> None:
    blocks = [range(count)[block] for block in row_blocks(count)]
    assert [row for block in blocks for row in block] == list(range(count))
    assert all(0 < len(block) <= ROWS_PER_BLOCK for block in blocks)


def test_rows_of_a_full_mask_are_the_array_itself() -> None:
    values = np.arange(6.0).reshape(3, 2)
    assert select_rows(values, np.ones(3, dtype=bool)) is values
    np.testing.assert_array_equal(select_rows(values, np.array([True, False, True])), values[::2])


def test_gathered_rows_are_those_of_the_indices() -> None:
    values = np.arange(30.0).reshape(10, 3)
    indices = np.random.default_rng(3).integers(0, 10, (ROWS_PER_BLOCK + 5, 3)).astype(np.int32)
    np.testing.assert_array_equal(gather_rows(values, indices), values[indices])


@pytest.mark.parametrize(("rows", "is_view"), [([2, 3, 4], True), ([2, 4], False), ([], False)])
def test_sorted_rows_without_a_gap_are_a_view(rows: list[int], is_view: bool) -> None:
    values = np.arange(12.0).reshape(6, 2)
    found = sorted_rows(values, np.array(rows, dtype=np.intp))
    np.testing.assert_array_equal(found, values[rows])
    assert np.shares_memory(found, values) == is_view
