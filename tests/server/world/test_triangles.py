"""Rows, clusters, boxes and distances of many triangles, against the plain way to compute each."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.triangles import (
    ROWS_PER_BLOCK,
    first_occurrences,
    gather_rows,
    make_clusters,
    row_blocks,
    select_rows,
    triangle_distances,
    visible_runs,
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
    found = first_occurrences(values)
    assert found.tolist() == np.flatnonzero(expected).tolist()


def test_first_occurrences_among_many_round_numbers_are_those_of_unique() -> None:
    rows = np.random.default_rng(2).integers(-3, 3, (20_000, 6)) * 0.5
    kept = rows[first_occurrences(rows)]
    np.testing.assert_array_equal(np.unique(kept, axis=0), np.unique(rows, axis=0))
    assert len(kept) == len(np.unique(rows, axis=0))


def triangles(count: int, *, seed: int = 0) -> Floats:
    rng = np.random.default_rng(seed)
    return rng.uniform(-5.0, 5.0, (count, 1, 3)) + rng.uniform(-0.1, 0.1, (count, 3, 3))


def test_order_is_a_permutation_cut_into_whole_groups() -> None:
    group = np.random.default_rng(1).integers(0, 3, 700)
    clusters = make_clusters(triangles(700), group, size=64)
    assert np.array_equal(np.sort(clusters.order), np.arange(700))
    for first, last, own in zip(
        clusters.offsets[:-1], clusters.offsets[1:], clusters.groups, strict=True
    ):
        assert 0 < last - first <= 64
        assert (group[clusters.order[first:last]] == own).all()


def test_boxes_contain_their_triangles() -> None:
    corners = triangles(300)
    clusters = make_clusters(corners, np.zeros(300, dtype=np.intp), size=32)
    for index, low, high in zip(
        range(len(clusters.box_min)), clusters.box_min, clusters.box_max, strict=True
    ):
        own = corners[clusters.order[clusters.offsets[index] : clusters.offsets[index + 1]]]
        assert (own >= low).all()
        assert (own <= high).all()


def test_neighbours_lie_in_one_cluster() -> None:
    corners = triangles(4096)
    clusters = make_clusters(corners, np.zeros(4096, dtype=np.intp), size=64)
    # A cube of 10 m in 64 pieces is 2.5 m a side; without an order a box would be all of it.
    assert np.median(np.ptp(np.stack((clusters.box_min, clusters.box_max)), axis=0)) < 4.0


def test_clusters_of_nothing_are_none() -> None:
    clusters = make_clusters(np.zeros((0, 3, 3)), np.zeros(0, dtype=np.intp))
    assert clusters.offsets.tolist() == [0]
    assert clusters.in_front_of_planes(np.eye(3), np.zeros(3)).shape == (0,)


def test_cluster_in_front_is_never_culled() -> None:
    corners = triangles(2000)
    clusters = make_clusters(corners, np.zeros(2000, dtype=np.intp), size=16)
    normals, point = np.random.default_rng(2).normal(size=(4, 3)), np.array([0.5, -1.0, 0.2])
    inside = ((corners - point) @ normals.T >= 0.0).all(axis=-1).any(axis=-1)[clusters.order]
    kept = np.repeat(clusters.in_front_of_planes(normals, point), np.diff(clusters.offsets))
    assert kept[inside].all()
    assert not kept.all()


def test_planes_of_several_faces_are_tested_at_once() -> None:
    clusters = make_clusters(triangles(2000), np.zeros(2000, dtype=np.intp), size=16)
    normals, point = np.random.default_rng(2).normal(size=(3, 4, 3)), np.array([0.5, -1.0, 0.2])
    alone = [clusters.in_front_of_planes(of_face, point) for of_face in normals]
    assert np.array_equal(clusters.in_front_of_planes(normals, point), alone)


def test_distance_to_a_box_is_zero_inside() -> None:
    corners = np.array([[[0, 0, 0], [2, 0, 0], [0, 2, 1]]], dtype=np.float64)
    clusters = make_clusters(corners, np.zeros(1, dtype=np.intp))
    assert clusters.distances(np.array([1.0, 1.0, 0.5])) == 0.0
    assert clusters.distances(np.array([5.0, 6.0, 1.0])) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("visible", "expected"),
    [
        ([False, False, False], []),
        ([True, True, True], [(0, 9)]),
        ([True, False, True], [(0, 4), (7, 2)]),
        ([False, True, False], [(4, 3)]),
    ],
)
def test_runs_join_neighbours(visible: list[bool], expected: list[tuple[int, int]]) -> None:
    assert visible_runs(np.array(visible), np.array([0, 4, 7, 9])) == expected


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


@pytest.mark.parametrize("sine", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 0.0])
def test_distance_of_a_sliver_is_never_above_that_of_its_points(sine: float) -> None:
    rng = np.random.default_rng(6)
    corners = rng.normal(size=(500, 3, 3)) * 10.0 ** rng.uniform(-2.0, 3.0, (500, 1, 1))
    along = rng.uniform(-0.5, 1.5, (500, 1))
    corners[:, 2] = corners[:, 0] + along * (corners[:, 1] - corners[:, 0]) + sine * corners[:, 2]
    weights = rng.dirichlet((0.5, 0.5, 0.5), 2000)
    for point in (np.zeros(3), corners[0].mean(axis=0), np.array((1e5, 0.0, 1e3))):
        sampled = np.linalg.norm(weights @ corners - point, axis=-1).min(axis=1)
        # To the rounding of coordinates.
        slack = 1e-13 * (np.abs(corners).max(axis=(1, 2)) + np.abs(point).max())
        assert (triangle_distances(point, corners) <= sampled + slack).all()
