"""A rectangle on the floor against triangles from above: exact at touch, fast in empty space."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.obstacle_grid import (
    ObstacleGrid,
    build_obstacle_grid,
    penetration_depths,
    rectangle_intersects,
    rectangles_intersect,
)
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.triangles import TriangleHierarchy
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, Shape, World

GREY = Material((0.5, 0.5, 0.5))
HALF_SIZE_M = (0.5, 0.25)


def make_obstacle_grid(
    *placed: tuple[Shape, tuple[float, float, float]], low_m: float = 0.03, high_m: float = 0.7
) -> ObstacleGrid:
    items = tuple(Item(f"{i}", s, Pose.from_rpy(p), GREY) for i, (s, p) in enumerate(placed))
    return build_obstacle_grid(build_scene(World("w", items)), low_m=low_m, high_m=high_m)


def intersects(obstacles: ObstacleGrid, x: float, y: float = 0.0, yaw: float = 0.0) -> bool:
    near = obstacles.triangles_near((x, y), math.hypot(*HALF_SIZE_M)).tolist()
    return rectangle_intersects(near, (x, y), yaw, half_size_m=HALF_SIZE_M)


BLOCK = make_obstacle_grid((Box((1.0, 1.0, 1.0)), (2.0, 0.0, -0.5)))  # from x = 1.5 to 2.5


@pytest.mark.parametrize(
    ("x", "y", "yaw", "hit"),
    [
        (1.0 - 1e-9, 0.0, 0.0, False),
        (1.0 + 1e-9, 0.0, 0.0, True),
        (2.0, 0.75 + 1e-9, 0.0, False),
        (2.0, 0.75 - 1e-9, 0.0, True),
        (1.25 - 1e-9, 0.0, 0.5 * math.pi, False),
        (1.25 + 1e-9, 0.0, 0.5 * math.pi, True),
        (2.0, 0.0, 1.0, True),  # inside
        (-50.0, 0.0, 0.0, False),
    ],
)
def test_rectangle_at_the_edge_of_a_block_touches_exactly(
    x: float, y: float, yaw: float, hit: bool
) -> None:
    assert intersects(BLOCK, x, y, yaw) is hit


def test_rectangle_at_45_degrees_touches_with_its_corner() -> None:
    reach = (HALF_SIZE_M[0] + HALF_SIZE_M[1]) * math.sqrt(0.5)
    assert not intersects(BLOCK, 1.5 - reach - 1e-9, 0.0, 0.25 * math.pi)
    assert intersects(BLOCK, 1.5 - reach + 1e-9, 0.0, 0.25 * math.pi)


def test_rectangle_beside_a_corner_is_separated_by_its_diagonal() -> None:
    # Bounding boxes overlap here, the shapes do not.
    assert not intersects(BLOCK, 1.1, 1.0, 0.25 * math.pi)


@pytest.mark.parametrize(
    ("shape", "height_m", "is_obstacle"),
    [
        (Rectangle((9.0, 9.0)), 0.0, False),  # the floor
        (Box((1.0, 1.0, 0.02)), 0.01, False),  # a sill
        (Box((1.0, 1.0, 0.1)), 0.05, True),  # a border
        (Box((1.0, 1.0, 0.1)), 0.8, False),  # a shelf above the mirror
        (Box((1.0, 1.0, 0.1)), 0.6, True),  # a table's top, into the mirror
        (Box((9.0, 9.0, 0.1)), 3.0, False),  # the ceiling
    ],
)
def test_shape_between_ankle_and_mirror_is_an_obstacle(
    shape: Shape, height_m: float, is_obstacle: bool
) -> None:
    assert intersects(make_obstacle_grid((shape, (0.0, 0.0, -height_m))), 0.0) is is_obstacle


def make_roof_grid() -> ObstacleGrid:
    """Roof of 45 degrees, 8 m wide, with both feet on the floor and its ridge along x."""
    slope = Rectangle((10.0, 4.0 * math.sqrt(2.0)))
    sides = (Pose.from_rpy((0.0, y, -2.0), (y * math.pi / 8.0, 0.0, 0.0)) for y in (-2.0, 2.0))
    items = tuple(Item(f"{i}", slope, pose, GREY) for i, pose in enumerate(sides))
    return build_obstacle_grid(build_scene(World("roof", items)), low_m=0.03, high_m=0.6)


def test_roof_is_an_obstacle_only_where_it_is_lower_than_the_robot() -> None:
    # 6.8 m are free; the rectangle is half a metre wide.
    roof = make_roof_grid()
    for side in (-1.0, 1.0):
        assert not intersects(roof, 0.0, side * (3.15 - 1e-9))
        assert intersects(roof, 0.0, side * (3.15 + 1e-9))
        # Lower than the robot's clearance the roof is driven over.
        assert intersects(roof, 0.0, side * (3.97 + 0.25 - 1e-9))
        assert not intersects(roof, 0.0, side * (3.97 + 0.25 + 1e-9))


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9), st.floats(-3.2, 3.2))
def test_triangle_is_an_obstacle_where_points_of_it_are_within_the_heights(
    numbers: list[float], yaw: float
) -> None:
    corners = np.array(numbers).reshape(3, 3)
    scene = replace(build_scene(World("w", ())), corners=corners[None], normals=np.zeros((1, 3)))
    grid = build_obstacle_grid(scene, low_m=0.1, high_m=0.5)
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 101), np.linspace(0.0, 1.0, 101))
    u, v = u[u + v <= 1.0], v[u + v <= 1.0]
    points = corners[0] + u[:, None] * (corners[1] - corners[0])
    points += v[:, None] * (corners[2] - corners[0])
    points = points[(points[:, 2] < -0.1) & (points[:, 2] > -0.5)][:, :2]
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    depth = 0.2 - np.abs(points @ turn).max(axis=1).min(initial=9.0)
    near = grid.triangles_near((0.0, 0.0), 0.3).tolist()
    hit = rectangle_intersects(near, (0.0, 0.0), yaw, half_size_m=(0.2, 0.2))
    # Points are up to 35 mm apart: what is nearer to touching than that is not judged.
    if abs(depth) > 0.035:
        assert hit is bool(depth > 0.0)


def test_empty_world_has_no_obstacles() -> None:
    assert not intersects(make_obstacle_grid(), 0.0)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3.2, 3.2))
def test_rectangle_intersects_as_sampled_points_do(x: float, y: float, yaw: float) -> None:
    block = make_obstacle_grid((Box((1.0, 1.0, 1.0)), (0.0, 0.0, -0.5)))
    along, across = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    points = np.stack((HALF_SIZE_M[0] * along, HALF_SIZE_M[1] * across), axis=-1)
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    depth = 0.5 - np.abs(points @ turn.T + (x, y)).max(axis=-1)
    # Points are 25 mm apart: what is nearer to touching than that is not judged.
    if abs(depth.max()) > 0.025:
        assert intersects(block, x, y, yaw) is bool(depth.max() > 0.0)


def test_distant_point_has_no_triangles_near() -> None:
    assert len(BLOCK.triangles_near((9.0, 9.0), 1.0)) == 0
    assert len(BLOCK.triangles_near((2.0, 0.0), 1.0)) >= 4


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3.2, 3.2))
def test_many_rectangles_intersect_as_each_alone(x: float, y: float, yaw: float) -> None:
    triangles = BLOCK.triangles_near((2.0, 0.0), 3.0)
    centres = np.array([(2.0 + x, y), (2.0 - x, y), (1.0, 0.0)])
    together = rectangles_intersect(triangles, centres, yaw, half_size_m=HALF_SIZE_M)
    alone = [
        rectangle_intersects(triangles.tolist(), (cx, cy), yaw, half_size_m=HALF_SIZE_M)
        for cx, cy in centres.tolist()
    ]
    assert together.tolist() == alone


def test_rectangles_among_many_triangles_intersect_what_each_meets() -> None:
    corner = np.array([(0.0, 0.0), (0.01, 0.0), (0.0, 0.01)])
    triangles = np.concatenate([corner[None] + (10.0 * column, 0.0) for column in range(1000)])
    triangles = triangles.reshape(-1, 3, 2)
    centres = np.array([(10.0 * column, 0.0) for column in range(1000)] + [(5.0, 0.0), (0.0, 5.0)])
    hit = rectangles_intersect(triangles, centres, 0.3, half_size_m=HALF_SIZE_M)
    assert hit.tolist() == [True] * 1000 + [False, False]


def test_rectangles_without_triangles_intersect_nothing() -> None:
    none = np.zeros((0, 3, 2))
    assert not rectangles_intersect(none, np.zeros((3, 2)), 0.0, half_size_m=HALF_SIZE_M).any()


# A wall seen from above: a segment of no width along x = 1.
WALL = [[[1.0, -9.0], [1.0, 9.0], [1.0, -9.0]]]


@pytest.mark.parametrize(
    ("x", "yaw", "depth_m"),
    [
        (0.4, 0.0, 0.0),
        (0.5, 0.0, 0.0),
        (0.6, 0.0, 0.1),
        (1.0, 0.0, 0.5),  # in the middle either way out is as long
        (1.4, 0.0, 0.1),  # the way out is ahead
        (0.8, 0.5 * math.pi, 0.05),
    ],
)
def test_depth_in_a_wall_is_the_way_to_the_nearer_side(
    x: float, yaw: float, depth_m: float
) -> None:
    (depth,) = penetration_depths(WALL, (x, 0.0), yaw, half_size_m=HALF_SIZE_M)
    assert depth == pytest.approx(depth_m, abs=1e-12)


@settings(derandomize=True, max_examples=100, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-3.2, 3.2))
def test_translation_by_less_than_the_depth_never_separates(x: float, y: float, yaw: float) -> None:
    triangle = [[[0.0, 0.0], [0.8, 0.1], [0.2, 0.7]]]
    (depth,) = penetration_depths(triangle, (x, y), yaw, half_size_m=HALF_SIZE_M)
    assert (depth > 0.0) <= rectangle_intersects(triangle, (x, y), yaw, half_size_m=HALF_SIZE_M)

    def separated_by(length_m: float) -> list[bool]:
        angles = np.linspace(-math.pi, math.pi, 720)
        places = np.array((x, y)) + length_m * np.stack((np.cos(angles), np.sin(angles)), axis=-1)
        hit = rectangles_intersect(np.array(triangle), places, yaw, half_size_m=HALF_SIZE_M)
        return (~hit).tolist()

    if depth > 1e-6:
        assert not any(separated_by(0.999 * depth))
        # One of 720 directions is within 0.25 degrees of the shortest way out.
        assert any(separated_by(1.001 * depth))


def test_triangles_that_are_one_from_above_are_kept_once() -> None:
    # A sill's top and bottom are two triangles each, of one outline; a side is seen on edge.
    sill = make_obstacle_grid((Box((1.0, 1.0, 0.2)), (2.0, 0.0, -0.1)))
    assert len(sill.triangles_near((2.0, 0.0), 9.0)) == 2 + 4 * 2


@pytest.mark.parametrize("is_shuffled", [False, True])
def test_triangles_near_are_those_found_one_by_one(is_shuffled: bool) -> None:
    boxes = [
        (Box((0.3, 0.3, 0.2)), (0.5 * column - 4.0, 0.5 * row - 4.0, 0.02 * (row - column) - 0.36))
        for column, row in np.ndindex(16, 16)
    ]
    if is_shuffled:
        np.random.default_rng(4).shuffle(boxes)
    items = [Item("box", box, Pose.from_rpy(place), GREY) for box, place in boxes]
    scene = build_scene(World("boxes", tuple(items)))
    # No box reaches out of the heights, which would clip it.
    grid = build_obstacle_grid(scene, low_m=-0.1, high_m=0.9)
    outlines = scene.corners[..., :2]
    low, high = outlines.min(axis=1), outlines.max(axis=1)
    for centre in np.random.default_rng(5).uniform(-6.0, 6.0, (40, 2)):
        near = ((low <= centre + 0.4) & (high >= centre - 0.4)).all(axis=1)
        expected = {outline.tobytes() for outline in outlines[near]}
        found = grid.triangles_near(tuple(centre.tolist()), 0.4)
        assert len(found) == len(expected)
        assert {outline.tobytes() for outline in found} == expected


def test_triangles_within_the_same_cells_are_searched_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    grid = make_obstacle_grid((Box((1.0, 1.0, 0.2)), (2.0, 0.0, -0.1)))
    assert len(grid.triangles_near((2.1, 0.1), 0.3))
    monkeypatch.setattr(TriangleHierarchy, "find_near", None)
    assert len(grid.triangles_near((2.15, 0.12), 0.3))
