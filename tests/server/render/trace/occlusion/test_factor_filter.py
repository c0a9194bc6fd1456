"""The atlas of bytes: nodes inside solids filled from beside, sets of rays mixed, grids apart."""

from __future__ import annotations

import numpy as np

from catoptra_server.render.trace.occlusion.baking import GridLayout, filter_factors
from catoptra_server.world.occlusion_map import OPEN


def make_layout(columns: int, rows: int) -> GridLayout:
    """Two equal grids, side by side without a gap."""
    both = np.ones(2, dtype=np.int32)
    left = np.array([0, columns], dtype=np.int32)
    return GridLayout(columns * both, rows * both, left, 0 * both, 2 * columns, rows)


def run_filter(
    values: np.ndarray[tuple[int, int], np.dtype[np.float64]],
    inside: np.ndarray[tuple[int, int], np.dtype[np.bool_]] | None = None,
) -> list[list[int]]:
    rows, columns = values.shape
    inside = np.zeros(values.shape, dtype=bool) if inside is None else inside
    near = np.zeros((rows, 2 * columns), dtype=bool)
    near[:, :columns] = True
    texels = filter_factors(
        make_layout(columns, rows), near, values[near[:, :columns]], inside[near[:, :columns]]
    )
    assert (texels[:, columns:] == OPEN).all()
    return texels[:, :columns].tolist()


def test_four_sets_of_rays_are_weighed_alike() -> None:
    pattern = np.tile([[0.2, 0.4], [0.6, 0.8]], (4, 4))
    texels = np.array(run_filter(pattern))
    assert (texels[1:-1, 1:-1] == round(0.5 * OPEN)).all()


def test_small_grid_is_left_as_it_is() -> None:
    assert run_filter(np.array([[0.0, 0.2], [0.4, 1.0]])) == [[0, 51], [102, 255]]


def test_nodes_inside_a_solid_take_their_neighbours_factors() -> None:
    values, inside = np.full((8, 8), 0.6), np.zeros((8, 8), dtype=bool)
    values[:, 4:], inside[:, 4:] = 0.0, True
    texels = np.array(run_filter(values, inside))
    assert (texels[:, :5] == round(0.6 * OPEN)).all()
    # Farther inside nobody looks: open, so that tiles there need no factors.
    assert (texels[:, 7] == OPEN).all()
