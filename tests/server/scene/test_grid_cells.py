"""Boxes in the cells of a grid, and rows that occur once, against the plain way to compute both."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_server.world.obstacle_grid import cell_members, first_occurrences


def members_one_by_one(
    low: np.ndarray, high: np.ndarray, cell_m: float
) -> dict[tuple[int, int], list[int]]:
    members: dict[tuple[int, int], list[int]] = {}
    first, last = np.floor(low / cell_m).astype(int), np.floor(high / cell_m).astype(int)
    for box, ((c0, r0), (c1, r1)) in enumerate(zip(first, last, strict=True)):
        for column, row in product(range(c0, c1 + 1), range(r0, r1 + 1)):
            members.setdefault((column, row), []).append(box)
    return members


@settings(derandomize=True, max_examples=100, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 40), st.sampled_from([0.01, 0.5, 3.0, 500.0]))
def test_members_of_cells_are_those_found_one_by_one(seed: int, count: int, cell_m: float) -> None:
    random = np.random.default_rng(seed)
    low = random.uniform(-5.0, 5.0, (count, 2))
    high = low + random.choice([0.0, 0.001, 1.0, 4.0], (count, 2)) * min(1.0, 10 * cell_m)
    found = cell_members(low.T, high.T, cell_m)
    assert {cell: sorted(boxes.tolist()) for cell, boxes in found.items()} == members_one_by_one(
        low, high, cell_m
    )


def test_grid_of_more_cells_than_16_bits_count_is_sorted() -> None:
    low = np.array([[0.0, 0.0], [999.5, 999.5], [999.5, 0.5]])
    found = cell_members(low.T, low.T, 1.0)
    assert {cell: boxes.tolist() for cell, boxes in found.items()} == {
        (0, 0): [0],
        (999, 999): [1],
        (999, 0): [2],
    }


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([], []),
        ([[1.0, 2.0], [1.0, 2.0], [2.0, 1.0]], [True, False, True]),
        ([[0.0, 1.0], [-0.0, 1.0]], [True, False]),
        ([[1.0, 1.0], [2.0, 2.0], [1.0, 1.0], [2.0, 2.0]], [True, True, False, False]),
    ],
)
def test_later_equals_of_a_row_are_no_first_occurrence(
    rows: list[list[float]], expected: list[bool]
) -> None:
    values = np.array(rows).reshape(-1, 2)
    found = first_occurrences(values, np.arange(len(values)))
    assert found.tolist() == np.flatnonzero(expected).tolist()


def test_first_occurrences_are_sought_among_the_given_rows_alone() -> None:
    values = np.array([[[1.0], [2.0]], [[3.0], [4.0]], [[1.0], [2.0]], [[1.0], [2.0]]])
    assert first_occurrences(values, np.array([1, 2, 3])).tolist() == [1, 2]


def test_first_occurrences_among_many_round_numbers_are_those_of_unique() -> None:
    rows = np.random.default_rng(2).integers(-3, 3, (20_000, 6)) * 0.5
    kept = rows[first_occurrences(rows, np.arange(len(rows)))]
    np.testing.assert_array_equal(np.unique(kept, axis=0), np.unique(rows, axis=0))
    assert len(kept) == len(np.unique(rows, axis=0))
