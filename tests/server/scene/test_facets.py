"""Normals, areas and the box of many triangles, against NumPy's own operations on each."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.shapes import bounding_box, facet_normals
from catoptra_server.world.triangles import ROWS_PER_BLOCK

CORNERS = np.random.default_rng(1).normal(size=(2 * ROWS_PER_BLOCK + 7, 3, 3))
UNIT_TRIANGLE = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])


def test_normals_of_many_triangles_are_those_of_the_cross_product() -> None:
    normals, has_area = facet_normals(CORNERS)
    cross = np.cross(CORNERS[:, 1] - CORNERS[:, 0], CORNERS[:, 2] - CORNERS[:, 0])
    expected = cross / np.linalg.norm(cross, axis=-1, keepdims=True)
    np.testing.assert_allclose(normals, expected, atol=1e-13)
    assert has_area.all()


@pytest.mark.parametrize("scale", [1e-170, 5e-324, 1e-3, 1.0, 1e150])
def test_normal_does_not_depend_on_the_size(scale: float) -> None:
    normals, has_area = facet_normals(scale * UNIT_TRIANGLE)
    np.testing.assert_array_equal(normals, [[0.0, 0.0, 1.0]])
    assert has_area.all()


@pytest.mark.parametrize(
    "corners",
    [
        [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]],
        [[1.0, 2, 3], [1, 2, 3], [0, 0, 1]],
        [[1.0, 2, 3], [1, 2, 3], [1, 2, 3]],
    ],
    ids=["line", "edge", "point"],
)
def test_triangle_without_area_has_normal_zero(corners: list[list[float]]) -> None:
    normals, has_area = facet_normals(np.array([corners]))
    np.testing.assert_array_equal(normals, 0.0)
    assert not has_area.any()


@pytest.mark.parametrize("count", [1, 63, 64, 65, len(CORNERS)])
def test_box_touches_the_extreme_corners(count: int) -> None:
    low, high = bounding_box(CORNERS[:count])
    np.testing.assert_array_equal(low, CORNERS[:count].min(axis=(0, 1)))
    np.testing.assert_array_equal(high, CORNERS[:count].max(axis=(0, 1)))


def test_box_of_no_triangles_is_inverted() -> None:
    low, high = bounding_box(np.zeros((0, 3, 3)))
    np.testing.assert_array_equal(low, np.inf)
    np.testing.assert_array_equal(high, -np.inf)
