"""First hits of rays, and dynamic objects, for each engine."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.trace_engine import NOTHING, STATIC_SCENE, MovingExposure
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, DynamicObject, build_object_mesh
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shapes import box, build_shape
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    DirectionalLight,
    HemisphereLight,
    Item,
    Material,
    PointLight,
    Rectangle,
    World,
)
from helpers.dynamic_objects import place_cube
from helpers.mesh_file_samples import make_quadrant_image
from helpers.trace_engines import (
    AT_ORIGIN,
    ENGINES,
    make_row_table,
    measure_rays,
    open_engine,
    render_rays,
)

pytestmark = pytest.mark.parametrize("engine", ENGINES)

WHITE = Material((1.0, 1.0, 1.0), unlit=True)
FLOOR = World("w", (Item("floor", Rectangle((2.0, 2.0)), Pose.from_rpy((0, 0, 1)), WHITE),))
DOWN, UP, AHEAD = (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)


def test_hits_name_range_triangle_and_object(engine: EngineName) -> None:
    exposure = replace(AT_ORIGIN, objects=(place_cube(9.0, 0.0, 0.0), place_cube(3.0, 0.0, 0.0)))
    with open_engine(engine, FLOOR) as opened:
        hits = opened.prepare(make_row_table((DOWN, AHEAD, UP))).find_hits(exposure)
        assert hits.object[0, 0, :3].tolist() == [STATIC_SCENE, 2, NOTHING]
        np.testing.assert_allclose(hits.range_m[0, 0, :3], (1.0, 2.8, np.inf), rtol=1e-6)
        assert hits.triangle[0, 0, 0] in (0, 1)
        assert 0 <= hits.triangle[0, 0, 1] < 12
        assert hits.triangle[0, 0, 2] == NOTHING


def test_object_behind_the_scene_is_hidden_and_one_before_it_hides_the_scene(
    engine: EngineName,
) -> None:
    wall = World("w", (Item("wall", Box((0.1, 4.0, 4.0)), Pose.from_rpy((2.0, 0, 0)), WHITE),))
    for distance_m, red in ((1.0, [1.0, 0.0, 0.0]), (3.0, [1.0, 1.0, 1.0])):
        exposure = replace(AT_ORIGIN, objects=(place_cube(distance_m, 0.0, 0.0),))
        assert render_rays(engine, wall, AHEAD, exposure=exposure).tolist() == [red]


def test_object_of_several_is_the_nearest(engine: EngineName) -> None:
    distances = (3.0, 2.0, 4.0)
    exposure = replace(AT_ORIGIN, objects=tuple(place_cube(x, 0.0, 0.0) for x in distances))
    assert measure_rays(engine, World("w", ()), AHEAD, exposure=exposure) == pytest.approx([1.8])


def test_object_is_lit_at_its_pose_by_lights_that_the_scene_culls(engine: EngineName) -> None:
    mesh = build_object_mesh([(box(Box((0.4, 0.4, 0.4))), Material((1.0, 1.0, 1.0)))])
    turned = DynamicObject(mesh, Pose.from_rpy((2.0, 0.0, 0.0), (0.0, 0.0, np.radians(60.0))))
    light = DirectionalLight((1.0, 0.0, 0.0), (1.0, 0.5, 0.2))
    seen = render_rays(
        engine,
        World("w", (), lights=(light,)),
        AHEAD,
        exposure=replace(AT_ORIGIN, objects=(turned,)),
    )
    # Normals of two faces are 60 and 30 degrees off the axis: its first hit is on the latter.
    expected = np.cos(np.radians(30.0)) * np.array(light.irradiance)
    np.testing.assert_allclose(seen[0], expected, atol=1e-5)


def test_round_object_is_lit_by_its_own_normals_while_it_turns(engine: EngineName) -> None:
    mesh = build_object_mesh(
        [(build_shape(Cylinder(0.5, 1.0, 24)), Material((0.8, 0.8, 0.8)))], is_smooth=True
    )
    light = DirectionalLight((1.0, 0.0, 0.0), (1.0, 0.5, 0.2))
    world = World("w", (), lights=(light, PointLight((-9.0, 0.0, -9.0), (0.0, 0.0, 4.0))))
    y = np.linspace(-0.4, 0.4, 16)
    origins = np.stack((0.0 * y, y, 0.0 * y), axis=-1)
    states = tuple(
        CameraState(
            Pose.identity(),
            (DynamicObject(mesh, Pose.from_rpy((3.0, 0.0, 0.0), (0.0, 0.0, yaw))),),
        )
        for yaw in (0.3, 0.4)
    )
    for lights in (world, replace(world, lights=(light,))):
        for exposure in (states[0], MovingExposure(states)):
            seen = render_rays(
                engine,
                lights,
                np.tile(AHEAD, (16, 1)),
                origins,
                exposure=exposure,
                times=0.0 * y + 0.5,
            )
            # Of the true cylinder; the chords of 24 sectors are met up to 5 mm behind it.
            expected = 0.8 * np.sqrt(1.0 - np.square(y / 0.5))
            np.testing.assert_allclose(seen[:, 0], expected, atol=0.015)
            # Of flat facets the same light would come in steps of up to 0.2.
            assert np.unique(seen[:, 0].round(5)).size >= 8


def test_smooth_object_without_round_parts_keeps_its_bytes(engine: EngineName) -> None:
    crate = (box(Box((0.4, 0.4, 0.4))), Material((0.7, 0.6, 0.5)))
    world = World("w", (), lights=(HemisphereLight((0.9, 0.9, 0.9), (0.2, 0.2, 0.2)),))
    place = Pose.from_rpy((2.0, 0.1, 0.2), (0.3, 0.2, 0.4))
    directions = np.stack([(1.0, 0.02 * i, 0.1) for i in range(-4, 8)])
    flat, smooth = (
        render_rays(
            engine,
            world,
            directions,
            exposure=replace(
                AT_ORIGIN,
                objects=(DynamicObject(build_object_mesh([crate], is_smooth=is_smooth), place),),
            ),
        )
        for is_smooth in (False, True)
    )
    assert flat.any()
    assert np.array_equal(flat, smooth)


def test_meshes_of_one_class_are_committed_once_for_all_frames(engine: EngineName) -> None:
    cube = place_cube(2.0, 0.0, 0.0)
    twin = replace(cube, world_from_object=Pose.from_rpy((0.0, 2.0, 0.0)))
    with open_engine(engine, World("w", ())) as opened:
        rays = opened.prepare(make_row_table(AHEAD))
        assert opened.num_object_meshes == 0  # type: ignore[attr-defined]
        for _ in range(3):
            rays.render_srgb(replace(AT_ORIGIN, objects=(cube, twin)))
        assert opened.num_object_meshes == 1  # type: ignore[attr-defined]


def test_textured_object_shows_what_the_same_item_of_the_scene_shows(
    engine: EngineName, tmp_path: Path
) -> None:
    make_quadrant_image().save(tmp_path / "t.png")
    material = Material((0.9, 0.8, 0.7), tmp_path / "t.png", tile_m=0.3)
    crate = Item("crate", Box((0.8, 0.6, 0.4)), Pose.from_rpy((0.1, 0.0, 0.2)), material)
    ball = replace(crate, name="ball", shape=Cylinder(0.3, 0.5), material=Material((0.3, 0.5, 0.2)))
    place = Pose.from_rpy((2.0, 0.1, 0.3), (0.3, 0.2, 0.4))
    lights = (HemisphereLight((0.7, 0.7, 0.7), (0.3, 0.3, 0.3)), PointLight((0, 0, -1.0), (1,) * 3))
    grid = np.linspace(-0.35, 0.35, 20)
    # Beside each other in blocks of 4 x 4 rays, of which rows alone are filled here.
    directions = np.array([(1.0, y, z) for z in grid for y in grid])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    mesh = build_object_mesh((), body=build_scene(World("body", (crate, ball))))
    there = CameraState(Pose.identity(), (DynamicObject(mesh, place),))
    # Parts of the way apart, at the place in the middle of the exposure.
    aside = np.array((0.0, 0.1, 0.0))
    before, after = (Pose(place.rotation, place.translation + by) for by in (-aside, aside))
    moving = MovingExposure(
        tuple(replace(there, objects=(DynamicObject(mesh, at),)) for at in (before, after))
    )
    for of in (lights[:1], lights):
        items = tuple(
            replace(item, world_from_item=place @ item.world_from_item) for item in (crate, ball)
        )
        expected = render_rays(engine, World("w", items, lights=of), directions)
        assert np.unique(expected.round(2), axis=0).shape[0] > 10
        for exposure in (there, moving):
            seen = render_rays(
                engine,
                World("w", (), lights=of),
                directions,
                exposure=exposure,
                times=np.full(len(directions), 0.5),
            )
            np.testing.assert_allclose(seen, expected, atol=2e-3)
