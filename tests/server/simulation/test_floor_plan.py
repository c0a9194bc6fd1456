"""Plans of a floor: obstacles at a robot's heights, and room for its base."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.simulation import floor_plan
from catoptra_server.simulation.floor_plan import FloorPlan, draw_floor_plan, find_start
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, Shape, World

GREY = Material((0.5, 0.5, 0.5))


def draw_plan(*placed: tuple[Shape, tuple[float, float, float]]) -> FloorPlan:
    """Plan of things on a floor of 4 x 4 m, in pixels of 2 cm."""
    floor: tuple[Shape, tuple[float, float, float]] = (Rectangle((4.0, 4.0)), (0.0, 0.0, 0.0))
    items = tuple(
        Item(f"{i}", s, Pose.from_rpy(p), GREY) for i, (s, p) in enumerate((floor, *placed))
    )
    points = np.array([(-1.5, -1.5), (1.5, 1.5)])
    return draw_floor_plan(
        build_scene(World("w", items)), height_m=0.6, points_m=points, size_px=200
    )


def look_up(plan: FloorPlan, raster: np.ndarray, x: float, y: float) -> bool:  # type: ignore[type-arg] # (h, w) bool
    column, row = plan.pixels(np.array([(x, y)]))[0].astype(int)
    return bool(raster[row, column])


@pytest.mark.parametrize(
    ("size_m", "bottom_m", "is_obstacle"),
    [
        ((0.4, 0.4, 0.3), 0.0, True),  # lower than the robot
        ((0.4, 0.4, 2.0), 0.0, True),  # a post, whose inside is no floor
        ((1.8, 1.8, 1.2), 0.0, True),  # a block
        ((0.4, 0.4, 0.1), 0.7, False),  # a shelf above
        ((0.4, 0.4, 0.1), 0.5, True),
        ((0.4, 0.4, 0.02), 0.0, False),  # driven over
    ],
)
def test_obstacle_is_what_the_robot_meets(
    size_m: tuple[float, float, float], bottom_m: float, is_obstacle: bool
) -> None:
    plan = draw_plan((Box(size_m), (0.5, 0.2, -bottom_m - 0.5 * size_m[2])))
    assert look_up(plan, plan.obstacles, 0.5, 0.2) is is_obstacle
    assert not look_up(plan, plan.obstacles, -1.0, -1.0)


def test_walls_that_touch_or_overlap_are_obstacles_all_over() -> None:
    # One ends at the face of another, one begins within it; a table's side begins within, too.
    boxes = [
        ((0.12, 2.24, 2.0), (1.06, 0.0)),
        ((1.0, 0.12, 2.0), (0.5, 1.06)),
        ((0.8, 0.12, 2.0), (0.65, -0.7)),
        ((0.05, 0.7, 0.7), (0.3, -0.4)),
    ]
    plan = draw_plan(*((Box(size), (*at, -0.5 * size[2])) for size, at in boxes))
    y, x = (np.indices(plan.obstacles.shape) + 0.5) / plan.px_per_m
    x, y = x + plan.origin_m[0], y + plan.origin_m[1]
    for (length, width, _), (at_x, at_y) in boxes:
        inside = (np.abs(x - at_x) < 0.5 * length) & (np.abs(y - at_y) < 0.5 * width)
        assert plan.obstacles[inside].all()
    assert not look_up(plan, plan.obstacles, 0.65, 0.2)


def test_free_is_where_the_base_has_floor_and_room() -> None:
    free = (plan := draw_plan((Box((0.4, 0.4, 1.0)), (0.5, 0.2, -0.5)))).find_free(0.3)
    assert look_up(plan, free, -0.5, 0.2)
    assert look_up(plan, free, 0.5 - 0.2 - 0.3 - 0.05, 0.2)
    assert not look_up(plan, free, 0.5 - 0.2 - 0.3 + 0.03, 0.2)


def test_place_without_floor_all_over_the_base_is_not_free() -> None:
    plan = draw_plan(
        (Rectangle((1.0, 1.0)), (3.0, 0.0, 0.0)), (Box((0.1, 0.1, 0.1)), (3, 0, -0.05))
    )
    free = plan.find_free(0.3)
    assert look_up(plan, free, 2.0 - 0.3 - 0.05, 1.0)
    assert not look_up(plan, free, 2.0 - 0.3 + 0.03, 1.0)


def test_world_without_anything_has_no_free_place() -> None:
    plan = draw_floor_plan(
        build_scene(World("w", ())), height_m=0.6, points_m=np.zeros((1, 2)), size_px=50
    )
    assert not plan.has_floor.any()
    assert not plan.obstacles.any()


def test_plan_does_not_depend_on_the_rays_that_are_cast_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    boxes = [
        (Box((0.4, 0.4, height)), (0.5, y, -0.5 * height)) for y, height in ((0.2, 2), (-1, 1))
    ]
    whole = draw_plan(*boxes)
    monkeypatch.setattr(floor_plan, "_BLOCK", 1000)
    plan = draw_plan(*boxes)
    for name in ("triangles", "has_floor", "obstacles"):
        np.testing.assert_array_equal(getattr(plan, name), getattr(whole, name))


def place_walls(*x_m: float, floor: tuple[float, float] | None = None) -> SceneMesh:
    """Walls of 4 m along y, and a floor of 3 x 3 m if it has a centre."""
    items = [
        Item(f"{i}", Box((0.2, 4.0, 1.0)), Pose.from_rpy((x, 0.0, -0.5)), GREY)
        for i, x in enumerate(x_m)
    ]
    if floor is not None:
        pose = Pose.from_rpy((*floor, 0.0))
        items.append(Item("floor", Rectangle((3.0, 3.0)), pose, GREY))
    return build_scene(World("w", tuple(items)))


def test_start_is_on_the_floor_and_without_any_between_obstacles() -> None:
    x, y = find_start(place_walls(-3.0, 3.0, floor=(1.5, 1.0))) or (0.0, 0.0)
    assert 0.4 <= x <= 2.5
    assert y <= 2.1
    # Between two walls, where 1.2 m are free on all sides.
    x, y = find_start(place_walls(-3.0, 0.0, 3.0)) or (0.0, 0.0)
    assert 1.2 < abs(x) < 1.8
    assert abs(y) < 0.1
    assert find_start(build_scene(World("w", ()))) is not None


def test_plan_for_a_base_ends_behind_what_it_reaches_from_the_points() -> None:
    shapes: list[tuple[Shape, tuple[float, float, float]]] = [
        (Rectangle((60.0, 60.0)), (0.0, 0.0, 0.0)),
        (Box((0.2, 60.0, 2.0)), (4.0, 0.0, -1.0)),  # a wall, and a post behind it
        (Box((0.2, 0.2, 2.0)), (25.0, 20.0, -1.0)),
        (Box((0.2, 60.0, 2.0)), (-4.0, 0.0, -1.0)),
        (Box((8.0, 0.2, 2.0)), (0.0, 3.0, -1.0)),
        (Box((6.0, 0.2, 2.0)), (-1.0, -3.0, -1.0)),  # a door of 0.9 m into a room
        (Box((8.0, 0.2, 2.0)), (0.0, -9.0, -1.0)),
    ]
    items = tuple(Item(f"{i}", s, Pose.from_rpy(p), GREY) for i, (s, p) in enumerate(shapes))
    scene = build_scene(World("w", items))
    for radius_m, least_y_m in ((0.3, -10.5), (0.6, -4.5)):
        plan = draw_floor_plan(
            scene, height_m=0.6, points_m=np.zeros((1, 2)), size_px=300, radius_m=radius_m
        )
        high_m = plan.origin_m[0] + plan.obstacles.shape[1] / plan.px_per_m
        assert plan.origin_m[0] == pytest.approx(-5.5, abs=1.0)
        assert high_m == pytest.approx(5.5, abs=1.0)
        assert plan.origin_m[1] == pytest.approx(least_y_m, abs=1.2)
