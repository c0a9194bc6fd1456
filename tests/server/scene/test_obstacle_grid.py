"""A rectangle on the floor against triangles from above: exact at touch, fast in empty space."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.scene.obstacle_grid import (
    ObstacleGrid,
    build_obstacle_grid,
    rectangle_intersects,
)
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import Box, Item, Material, Rectangle, Shape, World

GREY = Material((0.5, 0.5, 0.5))
HALF_SIZE_M = (0.5, 0.25)


def make_obstacle_grid(
    *placed: tuple[Shape, tuple[float, float, float]], low_m: float = 0.03, high_m: float = 0.7
) -> ObstacleGrid:
    items = tuple(Item(f"{i}", s, Pose.from_rpy(p), GREY) for i, (s, p) in enumerate(placed))
    return build_obstacle_grid(build_scene(World("w", items)), low_m=low_m, high_m=high_m)


def intersects(obstacles: ObstacleGrid, x: float, y: float = 0.0, yaw: float = 0.0) -> bool:
    near = obstacles.find_near((x, y), math.hypot(*HALF_SIZE_M))
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
    assert len(BLOCK.find_near((9.0, 9.0), 1.0)) == 0
    assert len(BLOCK.find_near((2.0, 0.0), 1.0)) >= 12
