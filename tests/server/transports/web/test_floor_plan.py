"""Sections of triangles by a level plane."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.serve.web.pages import floor_plan, section_segments
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, World

WHITE = Material((1.0, 1.0, 1.0))


def make_world(*items: Item) -> World:
    return World(name="test", items=items, lights=(), starts=(), landmarks=())


def box(name: str, size_m: tuple[float, float, float], x_m: float, z_m: float) -> Item:
    return Item(name, Box(size_m), Pose.from_rpy((x_m, 0.0, z_m)), WHITE)


FLOOR = Item("floor", Rectangle((6.0, 4.0)), Pose.identity(), WHITE)
WALL = box("wall", (0.1, 3.0, 1.0), 2.0, -0.5)


def total_length(segments: Floats) -> float:
    return float(np.hypot(*(segments[:, 2:] - segments[:, :2]).T).sum())


def test_wall_is_its_outline_and_the_floor_nothing() -> None:
    plan = floor_plan(build_scene(make_world(FLOOR, WALL)))
    segments = np.array(plan["segments"])
    assert total_length(segments) == pytest.approx(2.0 * (0.1 + 3.0), abs=1e-3)
    assert plan["bounds"] == pytest.approx([1.95, -1.5, 2.05, 1.5])
    assert plan["height_m"] == 0.3
    lengths = np.hypot(*(segments[:, 2:] - segments[:, :2]).T)
    assert np.all(np.diff(lengths) <= 1e-9)


@pytest.mark.parametrize("height_m", [0.05, 1.05])
def test_plane_below_and_above_an_item_meets_nothing(height_m: float) -> None:
    scene = build_scene(make_world(box("shelf", (1.0, 1.0, 0.5), 0.0, -0.6)))
    assert floor_plan(scene, height_m)["segments"] == []


def test_world_without_walls_has_the_bounds_of_the_floor_and_an_empty_one_a_square() -> None:
    assert floor_plan(build_scene(make_world(FLOOR)))["bounds"] == [-3.0, -2.0, 3.0, 2.0]
    assert floor_plan(build_scene(make_world()))["bounds"] == [-0.5, -0.5, 0.5, 0.5]


# z of the corners of a triangle over (0, 0), (1, 0), (0, 1), cut at z = 0, and the segment.
TRIANGLES = {
    "apart": ((1.0, 2.0, 3.0), None),
    "in the plane": ((0.0, 0.0, 0.0), None),
    "one corner touches from below": ((0.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.0)),
    "an edge in the plane": ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0)),
    "halves": ((-1.0, 1.0, 1.0), (0.5, 0.0, 0.0, 0.5)),
    "through a corner": ((-1.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.5)),
}


@pytest.mark.parametrize(("heights", "expected"), TRIANGLES.values(), ids=TRIANGLES.keys())
def test_triangle_in_hard_cases(
    heights: tuple[float, float, float], expected: tuple[float, ...] | None
) -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    corners[0, :, 2] = heights
    found = section_segments(corners, 0.0)
    if expected is None or expected[:2] == expected[2:]:
        assert len(found) == 0
    else:
        first, second = (
            np.sort(found.reshape(2, 2), axis=0),
            np.sort(np.reshape(expected, (2, 2)), axis=0),
        )
        np.testing.assert_allclose(first, second, atol=1e-12)


def test_segments_beyond_the_limit_are_the_shortest_ones() -> None:
    # Upright triangles of growing width, more than one block of them.
    width = np.random.default_rng(5).permutation(np.linspace(0.01, 10.0, 70000))
    corners = np.zeros((len(width), 3, 3))
    corners[:, :, 1] = np.arange(len(width))[:, None]
    corners[:, 1, 0] = 2.0 * width
    corners[:, 0:2, 2] = 1.0
    corners[:, 2, 2] = -1.0
    found = section_segments(corners, 0.0, max_segments=100)
    expected = np.sort(width)[::-1][:100]
    np.testing.assert_allclose(np.abs(found[:, 2] - found[:, 0]), expected, rtol=1e-12)


def test_edge_that_two_triangles_share_is_listed_once() -> None:
    triangle = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    corners = np.stack((triangle, triangle[[0, 2, 1]]))
    assert len(section_segments(corners, 0.0)) == 1
