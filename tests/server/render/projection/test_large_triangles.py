"""Pieces of large triangles: small for their distance, without cracks, and few."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.projection.large_triangles import (
    MAX_SIZE_PER_DISTANCE,
    LargeTriangles,
    TrianglePieces,
)
from catoptra_server.world.triangles import Indices, make_clusters

NEAR_M = 0.001


def make_sheet(seed: int, side_m: float, *, cells: int) -> Floats:
    """(n, 3, 3) triangles of an uneven sheet around the origin, in a random plane."""
    rng = np.random.default_rng(seed)
    places = np.linspace(-0.5, 0.5, cells + 1)
    grid = np.stack((*np.meshgrid(places, places, indexing="ij"), np.zeros((cells + 1,) * 2)), -1)
    grid[..., :2] += rng.uniform(-0.2, 0.2, (cells + 1, cells + 1, 2)) / cells
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    points = side_m * grid @ rotation.T
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    # Neighbours name the corners of their edge in the opposite order.
    return np.stack((np.stack((a, b, c), -2), np.stack((a, c, d), -2))).reshape(-1, 3, 3)


def make_large(corners: Floats) -> tuple[LargeTriangles, Indices]:
    clusters = make_clusters(corners, np.zeros(len(corners), dtype=np.intp))
    return LargeTriangles(clusters, corners), clusters.order


def edge_ratios(corners: Floats, point: Floats) -> Floats:
    """(n, 3) lengths of edges over their distances from a point."""
    first, second = corners - point, np.roll(corners, -1, axis=1) - point
    along = second - first
    place = -np.einsum("nki,nki->nk", first, along) / np.square(along).sum(axis=-1)
    nearest = first + np.clip(place, 0.0, 1.0)[..., None] * along
    distances = np.maximum(np.linalg.norm(nearest, axis=-1), NEAR_M)
    ratios: Floats = np.linalg.norm(along, axis=-1) / distances
    return ratios


def doubled_areas(corners: Floats) -> Floats:
    a, b, c = np.moveaxis(corners, 1, 0)
    areas: Floats = np.linalg.norm(np.cross(b - a, c - a), axis=-1)
    return areas


def open_length(corners: Floats) -> float:
    """Length of all edges that belong to one triangle alone."""
    ends = np.stack((corners, np.roll(corners, -1, axis=1)), axis=2).reshape(-1, 2, 3) + 0.0
    edges = {frozenset(map(bytes, edge)): edge for edge in ends}
    uses = Counter(frozenset(map(bytes, edge)) for edge in ends)
    return float(sum(np.linalg.norm(np.ptp(edges[k], axis=0)) for k, n in uses.items() if n == 1))


VIEWPOINTS = [(seed, height) for seed in range(4) for height in (0.0, 3e-4, 0.02, 0.3, 5.0)]


@pytest.mark.parametrize("side_m", [2.0, 2e3, 2e5])
@pytest.mark.parametrize(("seed", "height_m"), VIEWPOINTS)
def test_pieces_are_small_for_their_distance_and_cover_the_surface_without_a_crack(
    side_m: float, seed: int, height_m: float
) -> None:
    corners = make_sheet(seed, side_m, cells=3)
    rng = np.random.default_rng(seed)
    normal = np.cross(corners[0, 1] - corners[0, 0], corners[0, 2] - corners[0, 0])
    # Beside a corner, beside an edge, above the inside of a triangle.
    weights = ((1, 0, 0), (0.3, 0.7, 0), (0.4, 0.35, 0.25), (0.98, 0.01, 0.01))[seed]
    foot = np.array(weights) @ corners[rng.integers(len(corners))]
    viewpoint = foot + height_m * normal / np.linalg.norm(normal)
    whole, triangles, weights = make_large(corners)[0].replace(viewpoint)
    np.testing.assert_allclose(weights @ corners[triangles], whole, rtol=0.0, atol=1e-12 * side_m)
    assert edge_ratios(whole, viewpoint).max() <= MAX_SIZE_PER_DISTANCE * (1.0 + 1e-9)
    areas = np.bincount(triangles, doubled_areas(whole))
    np.testing.assert_allclose(areas, doubled_areas(corners), rtol=1e-9)
    # Edges inside the sheet belong to two pieces with the same bits: only its border is left.
    np.testing.assert_allclose(open_length(whole), open_length(corners), rtol=1e-9)


@pytest.mark.parametrize("side_m", [2.0, 2e3, 2e5, 2e7])
def test_number_of_pieces_grows_with_the_logarithm_of_size_over_distance(side_m: float) -> None:
    corners = make_sheet(1, side_m, cells=1)
    viewpoint = corners[0].mean(axis=0) + 0.02 * np.array((0.3, 0.9, -0.3))
    pieces = make_large(corners)[0].split(viewpoint)
    assert len(pieces.parents) <= 5 * np.log2(side_m / 0.02)


def test_weights_interpolate_the_corners() -> None:
    corners = make_sheet(2, 2e3, cells=2)
    large, order = make_large(corners)
    pieces = large.split(corners[3].mean(axis=0) + 0.02)
    assert len(pieces.replaced)
    assert (np.diff(pieces.parents) >= 0).all()
    found = pieces.weights @ corners[order[pieces.parents]]
    np.testing.assert_allclose(found, pieces.corners, atol=1e-12 * 2e3)


def test_pieces_hold_in_the_whole_cell_and_follow_from_the_viewpoint_alone() -> None:
    corners = make_sheet(3, 2e3, cells=2)
    corners += (0.0, 0.0, 0.4) - corners[3].mean(axis=0)
    large, again = make_large(corners)[0], make_large(corners)[0]
    rng = np.random.default_rng(3)
    same = 0
    last = large.split(np.zeros(3))
    for viewpoint in rng.normal(scale=0.003, size=(200, 3)).cumsum(axis=0):
        pieces = large.split(viewpoint)
        same += pieces is last
        last = pieces
        assert edge_ratios(pieces.corners, viewpoint).max() <= MAX_SIZE_PER_DISTANCE
    np.testing.assert_array_equal(again.split(viewpoint).corners, last.corners)
    assert same > 80, "most viewpoints share a cell with the one before"


def test_surfaces_that_are_small_for_their_distance_are_never_split() -> None:
    corners = make_sheet(4, 20.0, cells=1)
    large, _ = make_large(corners)
    normal = np.cross(*(corners[0, 1:] - corners[0, 0]))
    viewpoint = 0.6 * normal / np.linalg.norm(normal)
    pieces = large.split(viewpoint)
    assert not len(pieces.replaced)
    assert large.split(viewpoint + 3.0) is pieces, "nothing to upload anew"


def test_degenerate_triangles_end() -> None:
    line = np.array([[[-1e5, 0.0, 0.0], [1e5, 0.0, 0.0], [3.0, 0.0, 0.0]], np.zeros((3, 3))])
    whole, _, _ = make_large(line)[0].replace(np.array((0.0, 0.0, 1e-5)))
    assert np.isfinite(whole).all()
    assert (
        edge_ratios(whole[doubled_areas(whole) > 0.0], np.zeros(3)).max(initial=0.0)
        <= MAX_SIZE_PER_DISTANCE
    )


def test_runs_leave_out_what_is_replaced_and_end_with_the_pieces() -> None:
    pieces = TrianglePieces(
        np.array((2, 3, 9)), np.array((2, 2, 3, 9)), np.zeros((4, 3, 3)), np.zeros((4, 3, 3))
    )
    offsets = np.array((0, 4, 6, 8))
    every = np.ones(3, dtype=bool)
    assert pieces.runs(every, offsets, 20) == [(0, 2), (4, 4), (20, 3)]
    assert pieces.runs(np.array((False, True, False)), offsets, 20) == [(4, 2), (20, 3)]
    assert pieces.runs(~every, offsets, 20) == []
    assert pieces.runs(every[:1], np.array((8, 10)), 20) == [(8, 1), (23, 1)]
