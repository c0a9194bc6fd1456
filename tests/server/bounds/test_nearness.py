"""Nearness of triangles: an upper bound in every cell, and never far above."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.bounds.coordinate_rounding import (
    Nearness,
    NearTriangles,
    longest_edges,
)
from catoptra_server.world.triangles import triangle_distances


def scatter(seed: int, count: int, *, reach_m: float = 20.0) -> Floats:
    """(n, 3, 3) triangles of very different sizes, in an order without any sense."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-2.0, 1.0, (count, 1, 1))
    return rng.normal(size=(count, 3, 3)) * sizes + rng.uniform(-reach_m, reach_m, (count, 1, 3))


def exact_nearness(corners: Floats, point: Floats) -> Nearness:
    inverse = 1.0 / triangle_distances(point, corners)
    return Nearness(float(inverse.max()), float((inverse * longest_edges(corners)).max()))


@pytest.mark.parametrize(("count", "seed"), [(1, 1), (31, 2), (33, 3), (500, 4), (70_001, 5)])
def test_nearness_is_at_least_that_of_the_viewpoint_and_at_most_three_times(
    count: int, seed: int
) -> None:
    corners = scatter(seed, count)
    triangles = NearTriangles(corners)
    for point in np.random.default_rng(seed).uniform(-25.0, 25.0, (15, 3)):
        found, exact = triangles.nearness(point), exact_nearness(corners, point)
        # A cell adds half, and a box that was not measured another half.
        for name in ("inverse_distance_per_m", "size_per_distance"):
            assert getattr(exact, name) <= getattr(found, name) * (1.0 + 1e-9)
            assert getattr(found, name) <= 3.0 * getattr(exact, name)


def test_viewpoints_of_a_cell_share_one_evaluation() -> None:
    triangles = NearTriangles(scatter(6, 50) + np.array((100.0, 0.0, 0.0)))
    rng = np.random.default_rng(7)
    found = {triangles.nearness(point) for point in rng.uniform(-0.03, 0.03, (40, 3))}
    assert (len(found), triangles.num_evaluations) == (1, 1)


def test_result_does_not_depend_on_earlier_queries() -> None:
    corners = scatter(8, 300)
    points = np.random.default_rng(9).uniform(-20.0, 20.0, (30, 3))
    forward, backward = NearTriangles(corners), NearTriangles(corners)
    first = [forward.nearness(point) for point in points]
    assert first == [backward.nearness(point) for point in points[::-1]][::-1]


def test_no_triangle_is_no_nearness() -> None:
    assert NearTriangles(np.zeros((0, 3, 3))).nearness(np.zeros(3)) == Nearness(0.0, 0.0)


def test_viewpoint_on_a_surface_has_a_finite_nearness() -> None:
    corners = np.array([[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]]])
    assert NearTriangles(corners).nearness(np.zeros(3)).inverse_distance_per_m == 1e6
