from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.bounds.distances import (
    RingDistanceBvh,
    ViewpointBox,
    image_rings,
    rotation_to_axis,
)
from catoptra_server.effects.effect import NUM_RINGS
from helpers.worlds import make_omni_camera

RING = image_rings(make_omni_camera())
HERE = ViewpointBox(np.zeros(3), np.zeros(3), np.eye(3))


def soup(count: int, *, seed: int = 0, size_m: float = 0.3) -> tuple[Floats, Floats]:
    """Corners and normals of small triangles all around."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-4.0, 4.0, (count, 1, 3)) + rng.uniform(-size_m, size_m, (count, 3, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return corners, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def min_point_distances(corners: Floats, viewpoint: Floats, turn: Floats) -> Floats:
    """(NUM_RINGS,) smallest distances of many points of triangles, by ring."""
    shares = np.random.default_rng(1).dirichlet((0.5, 0.5, 0.5), 300)
    points = ((shares @ corners).reshape(-1, 3) - viewpoint) @ turn.T
    theta = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    ring, distance = np.searchsorted(RING.edges_rad[1:], theta), np.linalg.norm(points, axis=-1)
    return np.array([distance[ring == index].min(initial=np.inf) for index in range(NUM_RINGS)])


@pytest.mark.parametrize("count", [1, 40, 1500])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -0.8, -0.6)])
def test_no_point_of_any_triangle_is_nearer_than_its_ring_bound(
    count: int, axis: tuple[float, float, float]
) -> None:
    corners, normals = soup(count)
    turn = rotation_to_axis(axis)
    bounds = RingDistanceBvh(corners, normals).bounds(
        ViewpointBox(np.zeros(3), np.zeros(3), turn), RING
    )
    assert (bounds <= min_point_distances(corners, np.zeros(3), turn)).all()


def test_bounds_of_many_triangles_are_those_of_the_nearest() -> None:
    corners, normals = soup(1500, size_m=0.05)
    bounds = RingDistanceBvh(corners, normals).bounds(HERE, RING)
    shares = bounds / min_point_distances(corners, np.zeros(3), np.eye(3))
    # A box may reach into a ring that its triangle just misses.
    assert np.median(shares) > 0.95


def test_bounds_of_a_box_of_viewpoints_hold_for_each() -> None:
    corners, normals = soup(400)
    half = np.array((0.2, 0.1, 0.05))
    bvh = RingDistanceBvh(corners, normals)
    of_box = bvh.bounds(ViewpointBox(np.zeros(3), half, np.eye(3)), RING)
    for point in np.random.default_rng(2).uniform(-half, half, (20, 3)):
        assert (of_box <= min_point_distances(corners, point, np.eye(3))).all()


def test_bounds_with_few_triangles_are_looser_and_hold() -> None:
    corners, normals = soup(1500)
    bvh = RingDistanceBvh(corners, normals)
    hasty, patient = bvh.bounds(HERE, RING, max_triangles=0), bvh.bounds(HERE, RING)
    assert (hasty <= patient).all()
    assert (hasty < patient).any()


def test_bounds_with_a_cutoff_reach_the_cutoff_or_hold() -> None:
    corners, normals = soup(1500)
    bvh = RingDistanceBvh(corners, normals)
    whole = bvh.bounds(HERE, RING)
    enough = bvh.bounds(HERE, RING, cutoff=0.5 * whole)
    assert (enough >= 0.5 * whole).all()
    assert (enough <= whole).all()


def test_oblique_wall_is_as_far_as_its_plane() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    along, up, out = np.array((-s, c, 0.0)), np.array((0.0, 0.0, 1.0)), np.array((c, s, 0.0))
    corners = (out + np.array([[-5 * along - up, 5 * along - up, 5 * along + up]]))[0][None]
    bounds = RingDistanceBvh(corners, out[None]).bounds(HERE, RING)
    level = int(np.searchsorted(RING.edges_rad, 0.5 * np.pi)) - 1
    assert bounds[level] == pytest.approx(1.0, rel=1e-4)


def test_triangle_without_area_has_its_own_distance() -> None:
    corners = np.array([[[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]]])
    bounds = RingDistanceBvh(corners, np.zeros((1, 3))).bounds(HERE, RING)
    assert bounds[np.isfinite(bounds)] == pytest.approx(1.0, rel=1e-3)


def test_empty_set_is_infinitely_far() -> None:
    nothing = RingDistanceBvh(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    assert np.isinf(nothing.bounds(HERE, RING)).all()
