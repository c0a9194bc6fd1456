"""Dynamic objects in both renderers: equal images, with correct occlusion both ways.

Tolerances as in test_agreement.py.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world import shapes as primitives
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Light, Material, World
from helpers.dynamic_objects import (
    ROBOT_MESH,
    SMOOTH_ROBOTS,
    TWO_ROBOTS,
    build_textured_mesh,
    place_cube,
)
from helpers.image_comparison import level_differences, mask_away_from_edges
from helpers.renderers import RendererFactory
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)

HERE = Pose.identity()
AHEAD = PerspectiveCamera(60, 60, math.radians(60.0))


@contextmanager
def make_both(device: GlDevice, world: World) -> Iterator[tuple[RasterRenderer, TraceRenderer]]:
    scene = build_scene(world)
    trace = TraceRenderer(scene, world, threads=2)
    yield RasterRenderer(scene, world, device=device), trace
    trace.close()


def render_ahead(
    make_renderer: RendererFactory, world: World, *objects: DynamicObject, at: Pose = HERE
) -> Image:
    """Image of a forward camera in a world with objects."""
    view = make_renderer(world).prepare_perspective(AHEAD, 1)
    image = view.render(CameraState(at, objects)).rgb
    view.close()
    return image


def make_world(*items: Item) -> World:
    return World("boxes", items, lights=(HEMISPHERE_LIGHT,), background=(0.0, 0.0, 1.0))


def green_wall(x: float) -> Item:
    shape = Box((0.1, 2.0, 0.3))
    return Item("wall", shape, Pose.from_rpy((x, 0, 0)), Material((0, 1, 0), unlit=True))


@pytest.mark.parametrize("robots", [TWO_ROBOTS, SMOOTH_ROBOTS])
@pytest.mark.parametrize(
    "lights",
    [(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT), (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT)],
)
def test_raster_shows_two_robots_as_trace_does(
    device: GlDevice, lights: tuple[Light, ...], robots: tuple[DynamicObject, ...]
) -> None:
    world, camera = make_test_world(lights=lights), make_omni_camera(width_px=300)
    camera_state = dataclasses.replace(CAMERA_STATE, objects=robots)
    plan = make_plan(camera, face_size_px=640)
    with make_both(device, world) as renderers:
        raster, trace = (r.prepare(camera, plan).render(camera_state).rgb for r in renderers)
        without = renderers[1].prepare(camera, plan).render(CAMERA_STATE).rgb
    difference, smooth = level_differences(raster, trace), mask_away_from_edges(trace)
    on_bodies = level_differences(trace, without) > 0
    assert (smooth & on_bodies).sum() > 400
    levels = 3 if POINT_LIGHT in lights else 2
    assert (difference[smooth & on_bodies] > levels).mean() < 0.01
    assert (difference[smooth] > levels).mean() < 1e-3
    assert (difference > levels).mean() < 0.05


def test_raster_shows_robots_in_a_perspective_image_as_trace_does(device: GlDevice) -> None:
    world, camera = make_test_world(), PerspectiveCamera(320, 240, math.radians(100.0))
    camera_state = dataclasses.replace(CAMERA_STATE, objects=TWO_ROBOTS)
    with make_both(device, world) as renderers:
        raster, trace = (
            r.prepare_perspective(camera, 2).render(camera_state).rgb for r in renderers
        )
    # Sample positions are equal: only surfaces within a 256th of a sample may differ.
    assert (level_differences(raster, trace) > 2).mean() < 0.002


@pytest.mark.parametrize("lights", [(HEMISPHERE_LIGHT,), (DIRECTIONAL_LIGHT, POINT_LIGHT)])
@pytest.mark.parametrize("has_shadows", [False, True])
def test_raster_shows_textured_bodies_as_trace_does(
    device: GlDevice, lights: tuple[Light, ...], has_shadows: bool
) -> None:
    mesh = build_textured_mesh()
    objects = tuple(dataclasses.replace(robot, mesh=mesh) for robot in TWO_ROBOTS)
    state = dataclasses.replace(
        CAMERA_STATE, objects=(TWO_ROBOTS[0], *objects[1:]), has_shadows=has_shadows
    )
    world, camera = make_test_world(lights=lights), PerspectiveCamera(320, 240, math.radians(100.0))
    plain = dataclasses.replace(mesh, textures=())
    with make_both(device, world) as renderers:
        views = [renderer.prepare_perspective(camera, 2) for renderer in renderers]
        for placed in (objects, state.objects, TWO_ROBOTS):
            there = dataclasses.replace(state, objects=placed)
            raster, trace = (view.render(there).rgb for view in views)
            assert (level_differences(raster, trace) > 3).mean() < (0.02 if has_shadows else 0.004)
        flat = tuple(dataclasses.replace(one, mesh=plain) for one in objects)
        bare = views[1].render(dataclasses.replace(state, objects=flat)).rgb
        textured = views[1].render(dataclasses.replace(state, objects=objects)).rgb
    assert (level_differences(bare, textured) > 10).mean() > 0.01


def test_object_before_a_wall_occludes_the_wall(make_renderer: RendererFactory) -> None:
    image = render_ahead(
        make_renderer, make_world(green_wall(2.0)), place_cube(1.0, 0.0, 0.0, size_m=0.2)
    )
    assert image[30, 30].tolist() == [255, 0, 0]
    assert image[30, 5].tolist() == [0, 255, 0]


def test_wall_before_an_object_occludes_the_object(make_renderer: RendererFactory) -> None:
    image = render_ahead(
        make_renderer, make_world(green_wall(1.0)), place_cube(2.0, 0.0, 0.0, size_m=1.2)
    )
    assert image[30, 30].tolist() == [0, 255, 0]
    assert image[18, 30].tolist() == [255, 0, 0], "the part above the wall is visible"


@pytest.mark.parametrize("first_is_nearer", [True, False])
def test_nearer_of_two_objects_occludes_the_other(
    make_renderer: RendererFactory, first_is_nearer: bool
) -> None:
    near, far = (
        place_cube(1.0, 0.0, 0.0, size_m=0.2),
        DynamicObject(ROBOT_MESH, Pose.from_rpy((1.8, 0, 0.2))),
    )
    objects = (near, far) if first_is_nearer else (far, near)
    assert render_ahead(make_renderer, make_world(), *objects)[30, 30].tolist() == [255, 0, 0]


def test_object_follows_its_pose(make_renderer: RendererFactory) -> None:
    world = make_world(green_wall(3.0))
    view = make_renderer(world).prepare_perspective(AHEAD, 1)
    columns = []
    for y in (-0.3, 0.0, 0.3):
        image = view.render(CameraState(HERE, (place_cube(1.1, y, 0.0, size_m=0.2),))).rgb
        columns.append(np.nonzero(image[..., 0] > 128)[1].mean() + 0.5)
    view.close()
    # Nearest side at 1 m: y of 0.3 m is 0.3 focal lengths of 52 px away from the centre.
    assert columns == pytest.approx([30 - 15.6, 30, 30 + 15.6], abs=1.0)


def test_object_is_lit_as_the_same_mesh_in_the_scene(make_renderer: RendererFactory) -> None:
    box, look = Box((0.4, 0.5, 0.6)), Material((0.5, 0.4, 0.3))
    place = Pose.from_rpy((1.5, 0.1, 0.2), (0.2, 0.3, 0.7))
    lights = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT)
    fixed = World("fixed", (green_wall(4.0), Item("box", box, place, look)), lights=lights)
    empty = World("empty", (green_wall(4.0),), lights=lights)
    dynamic_object = DynamicObject(build_object_mesh([(primitives.box(box), look)]), place)
    difference = level_differences(
        render_ahead(make_renderer, fixed), render_ahead(make_renderer, empty, dynamic_object)
    )
    assert (difference > 1).mean() < 0.002


def test_object_that_touches_the_viewpoint_is_not_cut_away(make_renderer: RendererFactory) -> None:
    dynamic_object = place_cube(0.51 + 0.005, 0.0, 0.0, size_m=1.0)
    assert (
        render_ahead(make_renderer, make_world(green_wall(4.0)), dynamic_object) == (255, 0, 0)
    ).all()


def test_viewpoint_within_an_object_sees_it_from_inside(make_renderer: RendererFactory) -> None:
    assert (
        render_ahead(make_renderer, make_world(), place_cube(0.1, 0.0, 0.0, size_m=1.0))
        == (255, 0, 0)
    ).all()


def test_object_beyond_the_scene_is_not_cut_away(make_renderer: RendererFactory) -> None:
    small = Item("near", Box((0.1, 0.1, 0.1)), Pose.from_rpy((0.5, 0.6, 0.0)), Material((0, 1, 0)))
    image = render_ahead(make_renderer, make_world(small), place_cube(50.0, 0.0, 0.0, size_m=10.0))
    assert image[30, 30].tolist() == [255, 0, 0]


def test_objects_in_an_empty_world_far_from_the_origin_are_visible(
    make_renderer: RendererFactory,
) -> None:
    # Robots stay within a world's few hundred metres: there float32 resolves a tenth of a mm.
    far = (300.0, -200.0, 5.0)
    image = render_ahead(
        make_renderer, make_world(), place_cube(301.0, -200.0, 5.0), at=Pose.from_rpy(far)
    )
    assert image[30, 30].tolist() == [255, 0, 0]


def test_image_after_objects_left_is_the_one_before_they_came(
    make_renderer: RendererFactory,
) -> None:
    world = make_test_world()
    view = make_renderer(world).prepare(make_omni_camera(), make_plan(make_omni_camera()))
    before = view.render(CAMERA_STATE).rgb
    assert (view.render(dataclasses.replace(CAMERA_STATE, objects=TWO_ROBOTS)).rgb != before).any()
    assert np.array_equal(view.render(CAMERA_STATE).rgb, before)
    view.close()
