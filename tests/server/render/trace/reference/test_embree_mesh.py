"""Hits on a mesh: Embree's triangle, distances and weights in float64."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.reference.meshes import EmbreeMesh, hit_triangles

# Two triangles: a large one 3 m ahead, a small one 2 m ahead beside the axis.
CORNERS = np.array(
    [
        [(3.0, -1.0, -1.0), (3.0, 3.0, -1.0), (3.0, -1.0, 3.0)],
        [(2.0, 0.5, 0.5), (2.0, 0.7, 0.5), (2.0, 0.5, 0.7)],
    ]
)
AHEAD, ASIDE, BEHIND = (1.0, 0.0, 0.0), (1.0, 0.28, 0.28), (-1.0, 0.0, 0.0)


def unit(*directions: tuple[float, float, float]) -> Floats:
    found: Floats = np.array(directions)
    return found / np.linalg.norm(found, axis=-1, keepdims=True)


def test_first_hits_have_distance_triangle_and_weights() -> None:
    directions = unit(AHEAD, ASIDE, BEHIND)
    hits = EmbreeMesh(CORNERS).first_hits(np.zeros((3, 3)), directions)
    assert hits.triangle.tolist() == [0, 1, -1]
    np.testing.assert_allclose(hits.distance, (3.0, 2.0 / directions[1, 0], np.inf), rtol=1e-14)
    np.testing.assert_allclose(hits.weights[0], (0.25, 0.25))
    np.testing.assert_allclose(hits.weights[1], (0.3, 0.3))
    assert hits.weights[2].tolist() == [0.0, 0.0]


def test_distance_is_counted_in_lengths_of_the_direction() -> None:
    hits = EmbreeMesh(CORNERS).first_hits(np.zeros((1, 3)), np.array([(0.5, 0.0, 0.0)]))
    assert hits.distance.tolist() == [6.0]


def test_occlusion_ends_at_the_greatest_distance() -> None:
    mesh, origins = EmbreeMesh(CORNERS), np.zeros((3, 3))
    directions = np.tile(AHEAD, (3, 1))
    assert mesh.occludes(origins, directions, np.array((2.9, 3.1, np.inf))).tolist() == [
        False,
        True,
        True,
    ]


def test_mesh_without_triangles_is_never_hit() -> None:
    mesh = EmbreeMesh(np.zeros((0, 3, 3)))
    directions = unit(AHEAD, BEHIND)
    assert mesh.first_hits(np.zeros((2, 3)), directions).triangle.tolist() == [-1, -1]
    assert not mesh.occludes(np.zeros((2, 3)), directions, np.full(2, np.inf)).any()


def test_points_of_hits_are_those_of_the_triangle_to_float64() -> None:
    rng = np.random.default_rng(5)
    corners = rng.normal(size=(400, 3, 3))
    weights = rng.dirichlet((1.0, 1.0, 1.0), 400)
    points = np.einsum("nc,nci->ni", weights, corners)
    origins = points + rng.normal(size=(400, 3))
    directions = points - origins
    distance, found = hit_triangles(origins, directions, corners)
    np.testing.assert_allclose(distance, 1.0, rtol=1e-9)
    np.testing.assert_allclose(found, weights[:, 1:], atol=1e-9)


def test_ray_that_misses_its_triangle_by_rounding_hits_the_edge() -> None:
    past = np.array([(3.0, -1.0 - 1e-7, 0.0)])
    distance, weights = hit_triangles(np.zeros((1, 3)), past, CORNERS[:1])
    assert distance == pytest.approx([1.0], rel=1e-6)
    assert weights[0, 0] == 0.0
    assert weights[0, 1] == pytest.approx(0.25, abs=1e-6)


def test_ray_along_a_triangle_s_plane_and_one_without_area_hit_somewhere_on_them() -> None:
    flat = np.array([[(1.0, 0.0, 0.0), (2.0, 1.0, 0.0), (2.0, -1.0, 0.0)]])
    point = np.full((1, 3, 3), (2.0, 0.0, 0.0))
    with np.errstate(all="raise"):
        for corners, limits in ((flat, (0.9, 2.1)), (point, (1.999, 2.001))):
            distance, weights = hit_triangles(np.zeros((1, 3)), unit(AHEAD), corners)
            assert limits[0] < distance[0] < limits[1]
            assert (weights >= 0.0).all()
            assert weights.sum() <= 1.0
