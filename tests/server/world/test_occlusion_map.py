"""Factors of hemisphere light: interpolation between nodes, and the smallest of each triangle."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.shading import OPEN, OcclusionMap


def make_map() -> OcclusionMap:
    """Two triangles; the first has a grid of 3 x 2 nodes, half a metre apart, at (4, 0)."""
    texels = np.full((4, 8), OPEN, dtype=np.uint8)
    texels[:2, 4:7] = [[51, 102, 153], [255, 204, 0]]
    return OcclusionMap(
        np.array([0, -1], dtype=np.int32),
        np.array([[2.0, 0.0, 0.0, 4.0]]),
        np.array([[0.0, 2.0, 0.0, 0.0]]),
        np.array([[4, 0, 6, 1]], dtype=np.int32),
        texels,
    )


@pytest.mark.parametrize(
    ("x_m", "y_m", "factor"),
    [
        (0.0, 0.0, 0.2),
        (0.25, 0.0, 0.3),
        (0.25, 0.25, 0.6),
        (1.0, 0.5, 0.0),
        # Beside the grid: the nearest node's.
        (-1.0, -1.0, 0.2),
        (9.0, 0.0, 0.6),
    ],
)
def test_factor_is_interpolated_between_nodes(x_m: float, y_m: float, factor: float) -> None:
    at = np.array([[x_m, y_m, 7.0]])
    np.testing.assert_allclose(make_map().factors(np.array([0]), at), [[factor]], atol=1e-12)


def test_triangle_without_a_grid_is_open() -> None:
    assert make_map().factors(np.array([1, 0]), np.zeros((2, 3))).tolist() == [[1.0], [0.2]]


def test_smallest_factors_are_those_of_the_darkest_nodes() -> None:
    assert make_map().smallest_factors().tolist() == [[0.0], [1.0]]
    assert make_map().smallest_factors(slice(1, 2)).tolist() == [[1.0]]
