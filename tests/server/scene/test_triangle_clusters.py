from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.triangles import make_clusters, visible_runs


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
