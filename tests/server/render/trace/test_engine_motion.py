"""Moving exposures for each engine: every ray has a time of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.trace_engine import MovingExposure
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import Box, DirectionalLight, Item, Material, World
from helpers.dynamic_objects import build_cube_mesh, place_cube
from helpers.shadows import floor_item, make_world
from helpers.trace_engines import ENGINES, measure_rays, render_rays

pytestmark = pytest.mark.parametrize("engine", ENGINES)

NOON = DirectionalLight((0.0, 0.0, 1.0), (0.5, 0.5, 0.5))
WHITE = Material((1.0, 1.0, 1.0), unlit=True)
DOWN, UP, AHEAD = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)


WALL = World("w", (Item("wall", Box((0.2, 9.0, 9.0)), Pose.from_rpy((3.1, 0.0, 0.0)), WHITE),))
TIMES = np.array((0.0, 0.25, 0.5, 1.0))


def move(*poses: Pose, objects: tuple[tuple[DynamicObject, ...], ...] = ()) -> MovingExposure:
    """Exposure through poses, with objects at each of them."""
    placed = objects or ((),) * len(poses)
    return MovingExposure(tuple(map(CameraState, poses, placed)))


def test_camera_when_it_moves_is_at_the_place_of_each_ray_s_time(engine: EngineName) -> None:
    poses = [Pose.from_rpy((x, 0.0, 0.0)) for x in (0.0, 0.4, 1.6)]
    ahead = np.tile(AHEAD, (4, 1))
    found = measure_rays(engine, WALL, ahead, exposure=move(poses[0], poses[1]), times=TIMES)
    np.testing.assert_allclose(found, 3.0 - 0.4 * TIMES, rtol=1e-5)
    found = measure_rays(engine, WALL, ahead, exposure=move(*poses), times=TIMES)
    np.testing.assert_allclose(found, (3.0, 2.8, 2.6, 1.4), rtol=1e-5)


def test_times_when_nothing_moves_and_motion_without_times_show_the_first_state(
    engine: EngineName,
) -> None:
    ahead = np.tile(AHEAD, (4, 1))
    assert measure_rays(engine, WALL, ahead, times=TIMES) == pytest.approx([3.0] * 4)
    moving = move(Pose.identity(), Pose.from_rpy((1.0, 0.0, 0.0)))
    assert measure_rays(engine, WALL, ahead, exposure=moving) == pytest.approx([3.0] * 4)


def test_camera_when_it_turns_measures_metres_along_unit_directions(engine: EngineName) -> None:
    turned = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, 0.2))
    ahead = np.tile(AHEAD, (3, 1))
    found = measure_rays(
        engine, WALL, ahead, exposure=move(Pose.identity(), turned), times=(0.0, 0.5, 1.0)
    )
    # The mean of two rotations is shorter by cos 0.1, half a percent: distances are not.
    np.testing.assert_allclose(found, 3.0 / np.cos((0.0, 0.1, 0.2)), rtol=1e-5)


def test_object_when_it_moves_is_at_the_place_of_each_ray_s_time(engine: EngineName) -> None:
    near = place_cube(3.0, 0.0, 0.0)
    far = replace(near, world_from_object=Pose.from_rpy((5.0, 0.0, 0.0)))
    exposure = move(Pose.identity(), Pose.identity(), objects=((near,), (far,)))
    found = measure_rays(
        engine, World("w", ()), np.tile(AHEAD, (4, 1)), exposure=exposure, times=TIMES
    )
    np.testing.assert_allclose(found, 2.8 + 2.0 * TIMES, rtol=1e-5)


def test_object_when_it_turns_has_its_matrices_interpolated(engine: EngineName) -> None:
    still = place_cube(3.0, 0.0, 0.0)
    turned = replace(still, world_from_object=Pose.from_rpy((3.0, 0.0, 0.0), (0.0, 0.0, 0.4)))
    exposure = move(Pose.identity(), Pose.identity(), objects=((still,), (turned,)))
    found = measure_rays(
        engine, World("w", ()), np.tile(AHEAD, (3, 1)), exposure=exposure, times=(0.0, 0.5, 1.0)
    )
    # Half-way the cube is narrower by cos 0.2: its face is then as far along the axis as at rest.
    np.testing.assert_allclose(found, (2.8, 2.8, 3.0 - 0.2 / np.cos(0.4)), rtol=1e-5)


def test_object_when_it_turns_is_lit_by_the_normals_of_each_time(engine: EngineName) -> None:
    mesh = build_object_mesh([(box(Box((0.4, 0.4, 0.4))), Material((1.0, 1.0, 1.0)))])
    still, turned = (
        DynamicObject(mesh, Pose.from_rpy((3.0, 0.0, 0.0), (0.0, 0.0, yaw))) for yaw in (0.0, 0.4)
    )
    world = World("w", (), lights=(DirectionalLight((1.0, 0.0, 0.0), (1.0, 1.0, 1.0)),))
    exposure = move(Pose.identity(), Pose.identity(), objects=((still,), (turned,)))
    seen = render_rays(
        engine, world, np.tile(AHEAD, (3, 1)), exposure=exposure, times=(0.0, 0.5, 1.0)
    )
    np.testing.assert_allclose(seen[:, 0], np.cos((0.0, 0.2, 0.4)), atol=1e-4)


def test_shadow_of_a_moving_object_is_that_of_each_ray_s_time(engine: EngineName) -> None:
    mesh = build_cube_mesh(0.2)
    before, after = (DynamicObject(mesh, Pose.from_rpy((x, 0.0, -1.0))) for x in (-1.0, 1.0))
    above = Pose.from_rpy((0.0, 0.0, -0.1))
    states = tuple(CameraState(above, (placed,), has_shadows=True) for placed in (before, after))
    world = make_world(floor_item(), lights=(NOON,))
    seen = render_rays(
        engine, world, np.tile(DOWN, (3, 1)), exposure=MovingExposure(states), times=(0.0, 0.5, 1.0)
    )
    assert seen[:, 0].tolist() == pytest.approx([0.25, 0.0, 0.25])
