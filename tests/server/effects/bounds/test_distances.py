"""No point of a box, plane or triangle is nearer than the bound of its ring."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import NUM_RINGS
from catoptra_server.effects.bounds import distances
from catoptra_server.effects.bounds.distances import (
    DistanceBoundCache,
    ImageRings,
    ViewpointBox,
    bound_ring_distances,
    box_distance_bounds,
    image_rings,
    mirror_axis,
    rotation_to_axis,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.triangles import TriangleHierarchy
from helpers.effect_measurement import CAMERA
from helpers.range_images import FLOOR
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_test_world

PAPER_CAMERA = make_omni_camera()
RINGS = image_rings(PAPER_CAMERA)
EDGES = RINGS.edges_rad

metres = st.floats(-5.0, 5.0)
points = st.tuples(metres, metres, metres)


def ring_of(directions: Floats) -> Floats:
    """Ring of each (n, 3) direction; NUM_RINGS outside the mirror's view."""
    theta = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
    return np.searchsorted(EDGES[1:], theta)


def test_rings_have_equal_widths_in_the_image() -> None:
    directions = np.stack((np.sin(EDGES), 0.0 * EDGES, np.cos(EDGES)), axis=-1)
    directions[-1] = (math.sin(EDGES[-1] - 1e-9), 0.0, math.cos(EDGES[-1] - 1e-9))
    pixels, _ = pixel_from_direction(PAPER_CAMERA, directions)
    radius = np.linalg.norm(pixels - PAPER_CAMERA.centre_px, axis=-1)
    assert np.diff(radius) == pytest.approx(np.full(NUM_RINGS, 100.0 / NUM_RINGS), abs=1e-6)


@given(points, points, st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=150)
def test_no_point_of_a_box_is_nearer_than_its_ring_bound(
    one: tuple[float, ...], other: tuple[float, ...], seed: int
) -> None:
    low, high = np.minimum(one, other), np.maximum(one, other)
    inside = np.random.default_rng(seed).uniform(low, high, (200, 3))
    bounds = np.append(box_distance_bounds(low[None], high[None], RINGS)[0], 0.0)
    assert (np.linalg.norm(inside, axis=-1) >= bounds[ring_of(inside)] - 1e-12).all()


def test_floor_distance_follows_the_ring_angle() -> None:
    floor = np.array([[-50.0, -50.0, 0.6]]), np.array([[50.0, 50.0, 0.6]])
    bounds = box_distance_bounds(*floor, RINGS)[0]
    down = np.cos(EDGES[:-1])
    expected = np.where(down > 0.0, 0.6 / np.maximum(down, 1e-9), np.inf)
    # A box grows by 1e-5 of its farthest corner, which for this floor is 0.7 mm.
    assert bounds == pytest.approx(expected, rel=2e-3)


def test_small_box_is_bounded_in_its_own_ring_only() -> None:
    theta = 0.5 * (EDGES[3] + EDGES[4])
    point = 2.0 * np.array([[0.0, math.sin(theta), math.cos(theta)]])
    bounds = box_distance_bounds(point - 0.01, point + 0.01, RINGS)[0]
    assert np.flatnonzero(np.isfinite(bounds)).tolist() == [3]
    assert bounds[3] == pytest.approx(1.99, abs=0.01)


def test_box_around_the_viewpoint_has_distance_zero_in_every_ring() -> None:
    bounds = box_distance_bounds(np.array([[-1.0, -1.0, -1.0]]), np.array([[1.0, 2.0, 0.5]]), RINGS)
    assert bounds.tolist() == [[0.0] * NUM_RINGS]


HERE = ViewpointBox(np.zeros(3), np.zeros(3), np.eye(3))


def bound(
    corners: Floats, viewpoints: ViewpointBox = HERE, *, cutoff: Floats | None = None
) -> Floats:
    return bound_ring_distances(TriangleHierarchy(corners), viewpoints, RINGS, cutoff=cutoff)


def soup(count: int, *, size_m: float = 0.3) -> Floats:
    """Corners of small triangles all around."""
    rng = np.random.default_rng(0)
    return rng.uniform(-4.0, 4.0, (count, 1, 3)) + rng.uniform(-size_m, size_m, (count, 3, 3))


def min_point_distances(corners: Floats, viewpoint: Floats, turn: Floats) -> Floats:
    """(NUM_RINGS,) smallest distances of many points of triangles, by ring."""
    shares = np.random.default_rng(1).dirichlet((0.5, 0.5, 0.5), 300)
    points = ((shares @ corners).reshape(-1, 3) - viewpoint) @ turn.T
    ring, distance = ring_of(points), np.linalg.norm(points, axis=-1)
    return np.array([distance[ring == index].min(initial=np.inf) for index in range(NUM_RINGS)])


@pytest.mark.parametrize("count", [1, 40, 1500])
@pytest.mark.parametrize("axis", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -0.8, -0.6)])
def test_no_point_of_any_triangle_is_nearer_than_its_ring_bound(
    count: int, axis: tuple[float, float, float]
) -> None:
    corners = soup(count)
    turn = rotation_to_axis(axis)
    bounds = bound(corners, ViewpointBox(np.zeros(3), np.zeros(3), turn))
    assert (bounds <= min_point_distances(corners, np.zeros(3), turn)).all()


def test_bounds_of_many_triangles_are_those_of_the_nearest() -> None:
    corners = soup(1500, size_m=0.05)
    bounds = bound(corners)
    shares = bounds / min_point_distances(corners, np.zeros(3), np.eye(3))
    # A box may reach into a ring that its triangle just misses.
    assert np.median(shares) > 0.95


def test_bounds_of_a_box_of_viewpoints_hold_for_each() -> None:
    corners = soup(400)
    half = np.array((0.2, 0.1, 0.05))
    of_box = bound(corners, ViewpointBox(np.zeros(3), half, np.eye(3)))
    for point in np.random.default_rng(2).uniform(-half, half, (20, 3)):
        assert (of_box <= min_point_distances(corners, point, np.eye(3))).all()


def test_bounds_with_a_cutoff_reach_the_cutoff_or_hold() -> None:
    corners = soup(1500)
    whole = bound(corners)
    enough = bound(corners, cutoff=0.5 * whole)
    assert (enough >= 0.5 * whole).all()
    assert (enough <= whole).all()


def make_room(rings: int) -> Floats:
    """Inside of a ball of 3 m about (0.5, 0, 0), of 4 rings^2 triangles."""
    theta = np.linspace(0.01, np.pi - 0.01, rings + 1)
    theta, phi = np.meshgrid(theta, np.linspace(0.0, 2.0 * np.pi, 2 * rings + 1), indexing="ij")
    points = np.stack(
        (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)), axis=-1
    )
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    room: Floats = 3.0 * np.stack((a, b, c, a, c, d), axis=-2).reshape(-1, 3, 3)
    return room + np.array((0.5, 0.0, 0.0))


def count_bounded(monkeypatch: pytest.MonkeyPatch, corners: Floats) -> int:
    """Number of boxes and triangles that a cell of viewpoints needs."""
    numbers: list[int] = []

    def bound_boxes(low: Floats, high: Floats, rings: ImageRings) -> Floats:
        numbers.append(len(low))
        return box_distance_bounds(low, high, rings)

    monkeypatch.setattr(distances, "box_distance_bounds", bound_boxes)
    bound(corners, ViewpointBox(np.zeros(3), np.array((0.06, 0.06, 0.01)), np.eye(3)))
    return sum(numbers)


def test_room_of_many_triangles_is_as_far_as_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    coarse, fine = make_room(30), make_room(300)
    # All these are about as near, and there are twenty times as many as once were looked at.
    assert len(fine) == 360_000
    # The coarse room's facets cut the ball's edge by 4 mm.
    exact = min_point_distances(coarse, np.zeros(3), np.eye(3))
    for shares in (bound(corners) / exact for corners in (coarse, fine)):
        assert shares.max() <= 1.002
        assert shares.min() > 0.8
    assert count_bounded(monkeypatch, fine) < 4.0 * count_bounded(monkeypatch, coarse)


def test_many_triangles_behind_a_wall_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    wall = np.array([[[1.0, -9.0, -9.0], [1.0, 9.0, -9.0], [1.0, 0.0, 18.0]]])
    behind = [np.concatenate((wall, 0.05 * make_room(n) + (2.0, 0.0, 0.0))) for n in (25, 250)]
    few, many = (count_bounded(monkeypatch, corners) for corners in behind)
    assert many < 1.5 * few


def test_oblique_wall_is_as_far_as_its_plane() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    along, up, out = np.array((-s, c, 0.0)), np.array((0.0, 0.0, 1.0)), np.array((c, s, 0.0))
    corners = (out + np.array([[-5 * along - up, 5 * along - up, 5 * along + up]]))[0][None]
    bounds = bound(corners)
    level = int(np.searchsorted(EDGES, 0.5 * np.pi)) - 1
    assert bounds[level] == pytest.approx(1.0, rel=1e-4)


def test_viewpoints_on_both_sides_of_a_plane_are_no_distance_from_its_triangle() -> None:
    corners = np.array([[[-50.0, -50.0, 0.02], [0.0, 90.0, 0.02], [50.0, -50.0, 0.02]]])
    around = ViewpointBox(np.zeros(3), np.array((0.0, 0.0, 0.05)), np.eye(3))
    bounds = bound(corners, around)
    assert bounds.tolist() == [0.0] * NUM_RINGS


def test_triangle_without_area_has_its_own_distance() -> None:
    corners = np.array([[[1.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0]]])
    bounds = bound(corners)
    assert bounds[np.isfinite(bounds)] == pytest.approx(1.0, rel=1e-3)


def test_empty_set_is_infinitely_far() -> None:
    assert np.isinf(bound(np.zeros((0, 3, 3)))).all()


ROOM = build_scene(make_test_world())


@pytest.mark.parametrize(
    "axis", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.48, -0.6, -0.64)]
)
def test_rotation_takes_the_axis_to_z(axis: tuple[float, float, float]) -> None:
    turn = rotation_to_axis(axis)
    assert turn @ np.array(axis) == pytest.approx([0.0, 0.0, 1.0])
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_axis_of_upright_robots_does_not_depend_on_heading() -> None:
    axes = {
        mirror_axis(Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, yaw))) for yaw in (0.0, 1.0, -2.5)
    }
    assert axes == {(0.0, 0.0, 1.0)}


def test_distances_do_not_depend_on_earlier_queries() -> None:
    rng = np.random.default_rng(3)
    poses = [Pose.from_rpy((*rng.uniform(-1.5, 1.5, 2), -0.5)) for _ in range(10)]
    known = DistanceBoundCache(TriangleHierarchy(ROOM.corners))
    forth = [known.min_distances_m(pose, CAMERA) for pose in poses]
    assert forth == [
        DistanceBoundCache(TriangleHierarchy(ROOM.corners)).min_distances_m(pose, CAMERA)
        for pose in poses
    ]


def test_distances_along_a_short_drive_are_evaluated_once() -> None:
    surroundings = DistanceBoundCache(TriangleHierarchy(ROOM.corners))
    begin = surroundings.min_distances_m(CAMERA_STATE.world_from_mirror, CAMERA)
    found = surroundings.num_evaluations
    aside = np.array((0.002, 0.001, 0.0))
    near = replace(
        CAMERA_STATE.world_from_mirror,
        translation=CAMERA_STATE.world_from_mirror.translation + aside,
    )
    assert surroundings.min_distances_m(near, CAMERA) == begin
    assert surroundings.num_evaluations == found


def test_open_floor_shares_large_cells() -> None:
    surroundings = DistanceBoundCache(TriangleHierarchy(build_scene(FLOOR).corners))
    for x in np.linspace(0.0, 10.0, 101):
        nearest = surroundings.min_distances_m(Pose.from_rpy((x, 0.0, -0.6)), CAMERA)
        assert 0.5 < nearest[0] <= 0.6
    assert surroundings.num_evaluations < 30


def test_rocking_robots_share_bounds_that_hold_for_each() -> None:
    triangles = TriangleHierarchy(ROOM.corners)
    shared, rng = DistanceBoundCache(triangles), np.random.default_rng(4)
    shares = []
    for _ in range(300):
        tilt = (*rng.uniform(-0.12, 0.12, 2), rng.uniform(-3.0, 3.0))
        pose = Pose.from_rpy((0.3, -0.2, -0.6), tilt)
        here = ViewpointBox(pose.translation, np.zeros(3), rotation_to_axis(mirror_axis(pose)))
        exact = bound_ring_distances(triangles, here, image_rings(CAMERA))
        shares.append(shared.min_distances_m(pose, CAMERA) / exact)
    assert np.max(shares) <= 1.0
    assert np.median(shares) > 0.5
    # 9 x 9 axes, each in cells of one or two sizes.
    assert shared.num_evaluations < 170


def test_empty_world_is_infinitely_far() -> None:
    nothing = TriangleHierarchy(np.zeros((0, 3, 3)))
    nearest = DistanceBoundCache(nothing).min_distances_m(Pose.identity(), CAMERA)
    assert set(nearest) == {math.inf}
