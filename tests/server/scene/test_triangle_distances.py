"""Distances to triangles against a dense search over their points."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.triangles import triangle_distances

TRIANGLE = np.array([[[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]]])


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((1.0, 1.0, 2.0), 2.0),  # above the inside
        ((1.0, 1.0, -2.0), 2.0),
        ((2.0, -5.0, 0.0), 5.0),  # beside an edge
        ((-3.0, -4.0, 0.0), 5.0),  # beside a corner
        ((-3.0, -4.0, 12.0), 13.0),
        ((4.0 + 1.5, 0.0, 2.0), 2.5),
        ((1.0, 0.5, 0.0), 0.0),  # on it
    ],
)
def test_distance_is_that_of_plane_edge_or_corner(
    point: tuple[float, float, float], expected: float
) -> None:
    assert triangle_distances(np.array(point), TRIANGLE)[0] == pytest.approx(expected)


def test_triangle_without_area_is_a_line_or_a_point() -> None:
    line = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]]])
    assert triangle_distances(np.array((1.0, 3.0, 4.0)), line)[0] == pytest.approx(5.0)
    assert triangle_distances(np.array((3.0, 0.0, 4.0)), 0.0 * line)[0] == pytest.approx(5.0)


def test_distances_agree_with_the_nearest_of_many_points() -> None:
    rng = np.random.default_rng(5)
    corners = rng.normal(size=(200, 3, 3)) * rng.uniform(0.01, 3.0, (200, 1, 1))
    weights = np.sort(rng.uniform(size=(4000, 2)), axis=1)
    barycentric = np.column_stack((weights[:, 0], np.diff(weights, axis=1), 1.0 - weights[:, 1]))
    points = np.einsum("wk,nki->nwi", barycentric, corners)
    sampled = np.linalg.norm(points - (0.3, -0.2, 0.4), axis=-1).min(axis=1)
    exact = triangle_distances(np.array((0.3, -0.2, 0.4)), corners)
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
    assert (exact <= sampled + 1e-12).all()
    # 4000 points leave gaps of a twentieth of the longest edge.
    assert (sampled - exact <= 0.05 * longest).all()
