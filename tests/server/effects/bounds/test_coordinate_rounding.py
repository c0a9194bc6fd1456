"""Angles by rounding: upper bounds in every cell, never far above, that grow with the distance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds import coordinate_rounding
from catoptra_server.effects.bounds.coordinate_rounding import (
    UNIT_ROUNDOFF,
    CoordinateErrors,
    CoordinateRounding,
)
from catoptra_server.world.scene_mesh import MAX_FLOAT_REACH_M, SceneMesh, build_scene
from catoptra_server.world.triangles import triangle_distances
from catoptra_server.world.world_description import Item, Material, Rectangle, World
from helpers.dynamic_objects import place_cube

ERRORS = CoordinateErrors(position_ulps=2.0, size_ulps=4.0)
GREY = Material((0.5, 0.5, 0.5))


def make_rounding(scene: SceneMesh) -> CoordinateRounding:
    return CoordinateRounding(scene)


def floor_rounding(side_m: float, *, centre_m: float = 0.0) -> CoordinateRounding:
    """A square floor, centred on the x axis, 1 m below a viewpoint at the origin."""
    pose = Pose(np.eye(3), np.array((centre_m, 0.0, 1.0)))
    return make_rounding(
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
    # Up to a distance: from there on the camera is the origin.
    for away_m, is_origin in ((0.9 * MAX_FLOAT_REACH_M, False), (9e3, True)):
        cube = place_cube(away_m, 0.0, 0.0)
        viewpoint = np.array((away_m, 0.0, -2.0))
        alone = floor_rounding(20.0).max_angle_rad(viewpoint, (), ERRORS)
        beside = floor_rounding(20.0).max_angle_rad(viewpoint, (cube,), ERRORS)
        assert alone < 10.0 * UNIT_ROUNDOFF * 4.0
        assert (beside > 2.0 * away_m / 2.0 * UNIT_ROUNDOFF) == (not is_origin)


def test_object_counts_by_its_triangles_where_it_is_near_and_by_its_sphere_where_it_is_far() -> (
    None
):
    rounding = make_rounding(build_scene(World("empty", ())))
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
    rounding = make_rounding(build_scene(World("none", ())))
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
    return make_rounding(replace(build_scene(World("none", ())), corners=corners))


def bound_proximity(rounding: CoordinateRounding, point: Floats) -> tuple[float, float]:
    """Bounds of the same, by a distance and by the angle of a triangle's rounding alone."""
    angle_rad = rounding.max_angle_rad(point, (), CoordinateErrors(0.0, 1.0))
    return 1.0 / rounding.min_distance_m(point, ()), angle_rad / UNIT_ROUNDOFF - 1.0


@pytest.mark.parametrize(("count", "seed"), [(1, 1), (31, 2), (33, 3), (500, 4), (70_001, 5)])
def test_proximity_is_at_least_that_of_the_viewpoint_and_little_more(count: int, seed: int) -> None:
    corners = scatter(seed, count)
    rounding = round_triangles(corners)
    for point in np.random.default_rng(seed).uniform(-25.0, 25.0, (15, 3)):
        pairs = zip(exact_proximity(corners, point), bound_proximity(rounding, point), strict=True)
        # A cell's result is 1.5 times its centre's, which is 4/3 of the viewpoint's; and a box that
        # was not measured adds a tenth.
        for exact, bound in pairs:
            assert exact <= bound * (1.0 + 1e-9)
            assert bound <= 2.2 * exact


TRIANGLE = np.array([[[-1.0, -0.5, 0.0], [1.5, -1.0, 0.0], [0.0, 1.0, 0.25]]])
CLOSE = np.array((0.0, 1e-7, 1e-4, 0.03, 0.2))


@pytest.mark.parametrize("offset_m", [0.0, 1e5])
@pytest.mark.parametrize(
    "corners",
    [
        TRIANGLE,
        TRIANGLE[:, [0, 0, 0]],
        TRIANGLE[:, [0, 1, 1]],
        # A box around the viewpoint, and slivers that are lines but for a nanometre.
        np.concatenate([TRIANGLE + np.eye(3)[i] * s for i in range(3) for s in (-0.5, 0.5)]),
        TRIANGLE + np.array((0.0, 0.0, 1.0)) * (1e-9, 0.0, -1e-9) * np.eye(3)[2],
        np.concatenate([TRIANGLE * 10.0**-size for size in range(9)]),
    ],
    ids=["one", "point", "line", "box", "sliver", "sizes"],
)
def test_proximity_holds_near_surfaces_and_borders_of_cells(
    corners: Floats, offset_m: float
) -> None:
    corners = corners + np.array((offset_m, -offset_m, 0.0))
    rounding = round_triangles(corners)
    on_it = [corners[0, 0], corners[0, :2].mean(axis=0), corners[0].mean(axis=0)]
    # Borders lie half a side from the centre of a cell, heights at an eighth of a side.
    borders = [np.round(point * 16.0) / 16.0 + 1.0 / 32.0 for point in on_it]
    steps = [side * step * axis for side in (-1.0, 1.0) for step in CLOSE for axis in np.eye(3)]
    for point in (start + step for start in (*on_it, *borders) for step in steps):
        # Viewpoints count as no nearer than a micrometre.
        exact = 1.0 / np.maximum(triangle_distances(point, corners), 1e-6)
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
        nearest, size = bound_proximity(rounding, point)
        assert exact.max() <= nearest * (1.0 + 1e-9)
        # By an angle of at most pi, which has one rounding of its size.
        assert (exact * edges).max() <= (size + 1.0) * (1.0 + 1e-9)


def make_bumps(quads: int, side_m: float) -> Floats:
    """(n, 3, 3) triangles of a bumpy square, row by row."""
    x, y = np.meshgrid(*2 * [np.linspace(-0.5 * side_m, 0.5 * side_m, quads + 1)], indexing="ij")
    points = np.stack((x, y, 0.1 * np.sin(5.0 * x) * np.cos(7.0 * y)), axis=-1)
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.stack((a, b, c, a, c, d), axis=-2).reshape(-1, 3, 3)


def test_new_cell_measures_few_of_many_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = make_bumps(200, 10.0)
    rounding, measured = round_triangles(corners), []

    def measure(point: Floats, some: Floats) -> Floats:
        measured.append(len(some))
        return triangle_distances(point, some)

    monkeypatch.setattr(coordinate_rounding, "triangle_distances", measure)
    points = np.stack((np.linspace(-3.0, 3.0, 600), np.full(600, 0.3), np.full(600, -0.6)), axis=1)
    found = [rounding.min_distance_m(point, ()) for point in points]
    # One batch in twelve frames: cells are a quarter or a half of a metre long.
    assert len(measured) <= 50
    assert max(measured) <= 512
    for point, nearest_m in list(zip(points, found, strict=True))[::40]:
        assert nearest_m <= triangle_distances(point, corners).min()


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
