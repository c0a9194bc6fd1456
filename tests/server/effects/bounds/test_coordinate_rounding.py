"""Angles by rounding: upper bounds in every cell, never far above, that grow with the distance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.coordinate_rounding import (
    UNIT_ROUNDOFF,
    CoordinateErrors,
    CoordinateRounding,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.triangles import triangle_distances
from catoptra_server.world.world_description import Item, Material, Rectangle, World
from helpers.dynamic_objects import place_cube

ERRORS = CoordinateErrors(position_ulps=2.0, size_ulps=4.0)
GREY = Material((0.5, 0.5, 0.5))


def floor_rounding(side_m: float, *, centre_m: float = 0.0) -> CoordinateRounding:
    """A square floor, centred on the x axis, 1 m below a viewpoint at the origin."""
    pose = Pose(np.eye(3), np.array((centre_m, 0.0, 1.0)))
    return CoordinateRounding(
        build_scene(World("f", (Item("f", Rectangle((side_m, side_m)), pose, GREY),)))
    )


def test_angle_over_a_floor_is_its_diagonal_over_its_distance() -> None:
    for side_m in (20.0, 2e4):
        angle_rad = floor_rounding(side_m).max_angle_rad(np.zeros(3), (), ERRORS)
        expected_ulps = 4.0 * (math.hypot(side_m, side_m) + 1.0) + 2.0 * 1.0
        # A cell of a quarter of a metre adds less than half.
        assert 1.0 <= angle_rad / (expected_ulps * UNIT_ROUNDOFF) <= 1.5


def test_viewpoint_far_from_the_centre_adds_its_distance() -> None:
    near = floor_rounding(20.0).max_angle_rad(np.zeros(3), (), ERRORS)
    far = floor_rounding(20.0, centre_m=9e3)
    angle_rad = far.max_angle_rad(np.array((9e3, 0.0, 0.0)), (), ERRORS)
    assert angle_rad == pytest.approx(near, rel=1e-6), "only the centre of the scene counts"
    cube = place_cube(9e3, 0.0, 0.0)
    alone = floor_rounding(20.0).max_angle_rad(np.array((9e3, 0.0, -2.0)), (), ERRORS)
    beside = floor_rounding(20.0).max_angle_rad(np.array((9e3, 0.0, -2.0)), (cube,), ERRORS)
    assert alone < 10.0 * UNIT_ROUNDOFF * 4.0
    assert beside > 2.0 * 9e3 / 2.0 * UNIT_ROUNDOFF


def test_object_counts_by_its_triangles_where_it_is_near_and_by_its_sphere_where_it_is_far() -> (
    None
):
    rounding = CoordinateRounding(build_scene(World("empty", ())))
    cube = place_cube(0.0, 0.0, 0.0)
    radius_m = cube.mesh.radius_m
    angles = [
        rounding.max_angle_rad(np.array((0.0, 0.0, -height)), (cube,), ERRORS)
        for height in (10.0 * radius_m, 2.5 * radius_m, 1.1 * radius_m, 0.95 * radius_m)
    ]
    assert angles == sorted(angles)
    assert angles[-1] < 1e-4


def test_viewpoint_on_a_surface_has_an_angle_of_pi_at_most() -> None:
    rounding = floor_rounding(2e6)
    assert rounding.max_angle_rad(np.array((0.0, 0.0, 1.0)), (), ERRORS) == math.pi


@pytest.mark.parametrize("height_m", [0.01, 0.3, 1.0, 4.0])
def test_smallest_distance_is_a_lower_bound(height_m: float) -> None:
    rounding = floor_rounding(20.0)
    viewpoint = np.array((0.3, 0.2, 1.0 - height_m))
    most = (1.0 + 1e-9) * height_m
    assert 0.4 * height_m <= rounding.min_distance_m(viewpoint, ()) <= most
    # A cube beside the viewpoint, nearer than the floor.
    cube = place_cube(0.3 + 0.75 * height_m, 0.2, 1.0 - height_m, size_m=0.5 * height_m)
    assert 0.2 * height_m <= rounding.min_distance_m(viewpoint, (cube,)) <= 0.5 * most


def test_empty_scene_is_infinitely_far() -> None:
    rounding = CoordinateRounding(build_scene(World("none", ())))
    assert rounding.min_distance_m(np.zeros(3), ()) == math.inf


def scatter(seed: int, count: int, *, reach_m: float = 20.0) -> Floats:
    """(n, 3, 3) triangles of very different sizes, in an order without any sense."""
    rng = np.random.default_rng(seed)
    sizes = 10.0 ** rng.uniform(-2.0, 1.0, (count, 1, 1))
    return rng.normal(size=(count, 3, 3)) * sizes + rng.uniform(-reach_m, reach_m, (count, 1, 3))


def exact_proximity(corners: Floats, point: Floats) -> tuple[float, float]:
    """Inverse distance of the nearest triangle, and the largest size over distance."""
    inverse = 1.0 / triangle_distances(point, corners)
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    return float(inverse.max()), float((inverse * edges.max(axis=1)).max())


def round_triangles(corners: Floats) -> CoordinateRounding:
    return CoordinateRounding(replace(build_scene(World("none", ())), corners=corners))


def bound_proximity(rounding: CoordinateRounding, point: Floats) -> tuple[float, float]:
    """Bounds of the same, by a distance and by the angle of a triangle's rounding alone."""
    angle_rad = rounding.max_angle_rad(point, (), CoordinateErrors(0.0, 1.0))
    return 1.0 / rounding.min_distance_m(point, ()), angle_rad / UNIT_ROUNDOFF - 1.0


@pytest.mark.parametrize(("count", "seed"), [(1, 1), (31, 2), (33, 3), (500, 4), (70_001, 5)])
def test_proximity_is_at_least_that_of_the_viewpoint_and_at_most_three_times(
    count: int, seed: int
) -> None:
    corners = scatter(seed, count)
    rounding = round_triangles(corners)
    for point in np.random.default_rng(seed).uniform(-25.0, 25.0, (15, 3)):
        pairs = zip(exact_proximity(corners, point), bound_proximity(rounding, point), strict=True)
        # A cell adds half, and a box that was not measured another half.
        for exact, bound in pairs:
            assert exact <= bound * (1.0 + 1e-9)
            assert bound <= 3.0 * exact


def test_viewpoints_of_a_cell_share_one_result() -> None:
    rounding = round_triangles(scatter(6, 50) + np.array((100.0, 0.0, 0.0)))
    points = np.random.default_rng(7).uniform(-0.03, 0.03, (40, 3))
    assert len({rounding.min_distance_m(point, ()) for point in points}) == 1


def test_result_does_not_depend_on_earlier_queries() -> None:
    corners = scatter(8, 300)
    points = np.random.default_rng(9).uniform(-20.0, 20.0, (30, 3))
    forward, backward = round_triangles(corners), round_triangles(corners)
    first = [bound_proximity(forward, point) for point in points]
    assert first == [bound_proximity(backward, point) for point in points[::-1]][::-1]


def test_viewpoint_on_a_surface_has_a_finite_proximity() -> None:
    corners = np.array([[[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]]])
    # A viewpoint counts to a nanometre.
    nearest_m = round_triangles(corners).min_distance_m(np.zeros(3), ())
    assert nearest_m <= 1e-6
    assert nearest_m == pytest.approx(1e-6, rel=1e-3)
