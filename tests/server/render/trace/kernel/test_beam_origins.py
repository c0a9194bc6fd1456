"""Beams of rays without a viewpoint: the same images as with every ray traced.

C code: `src/beam_origins.c`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import (
    ConicalMirror,
    EquiangularMirror,
    ProfileMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.effects import Threshold
from catoptra_server.render.trace.ray_table import RayTable, omni_ray_table
from catoptra_server.render.trace.trace_engine import TraceRequest
from catoptra_server.world.objects import FogMedium, Shutter
from catoptra_server.world.world_description import (
    Box,
    HemisphereLight,
    Item,
    Material,
    PointLight,
    Rectangle,
    World,
)
from helpers.dynamic_objects import TWO_ROBOTS, place_cube
from helpers.image_comparison import grey_levels, level_differences
from helpers.mirror_checks import make_camera
from helpers.motion_reference import (
    START_POSES,
    camera_state_after,
    crossing_object,
    driving_camera_state,
    load_world_setup,
    time_samples,
)
from helpers.random_worlds import make_random_exposure
from helpers.trace_kernels import (
    count_differences,
    fill_and_trace,
    open_kernel,
    render_filled_and_traced,
)
from helpers.worlds import (
    CAMERA_STATE,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_plan,
    make_test_world,
    write_smooth_texture,
)
from measurements import scenes

SAG_R = (0.0, 0.01, 0.02, 0.03, 0.05)
MIRRORS: dict[str, NonCentralMirror] = {
    "spherical": SphericalMirror(0.03, 0.2),
    "conical": ConicalMirror(math.radians(60.0), 0.1, math.radians(100.0)),
    "equiangular": EquiangularMirror(11.0, 0.1),
    "profile": ProfileMirror(SAG_R, tuple(8.0 * r * r for r in SAG_R), 0.2, math.radians(70.0)),
}
SIZES = ((72, 1), (58, 2), (30, 4))
WORLDS_PER_TABLE = 10
GREY = Material((0.5, 0.5, 0.5))


def make_table(name: str, *, width_px: int, samples: int) -> RayTable:
    camera = make_camera(MIRRORS[name], width_px)
    table = omni_ray_table(camera, make_plan(camera, samples=samples))
    assert table.origins is not None
    return table


def make_near_world(distance_m: float) -> World:
    """Bars and plates at one distance all around and below, over a floor."""
    items = [Item("floor", Rectangle((20, 20)), Pose.identity(), Material((0.1, 0.3, 0.1)))]
    rng = np.random.default_rng(7)
    for index in range(60):
        azimuth, elevation = rng.uniform(-math.pi, math.pi), rng.uniform(-0.4, 1.2)
        point = distance_m * np.array(
            [
                math.cos(azimuth) * math.cos(elevation),
                math.sin(azimuth) * math.cos(elevation),
                math.sin(elevation),
            ]
        )
        turn = tuple(rng.uniform(-3.0, 3.0, 3))
        size = distance_m * rng.uniform(0.005, 0.3, 3)
        colour = Material(tuple(rng.uniform(0.0, 1.0, 3)), unlit=True)
        pose = Pose.from_rpy(tuple(point + CAMERA_STATE.world_from_mirror.translation), turn)
        items.append(Item(f"bar {index}", Box(tuple(size)), pose, colour))
    light = HemisphereLight((0.7, 0.7, 0.7), (0.3, 0.3, 0.3))
    return World("near", tuple(items), lights=(light,), background=(0.3, 0.3, 0.35))


@pytest.mark.parametrize(("width_px", "samples"), SIZES)
@pytest.mark.parametrize("name", MIRRORS)
def test_image_of_random_worlds_when_filled_is_the_traced_one(
    name: str, width_px: int, samples: int
) -> None:
    table = make_table(name, width_px=width_px, samples=samples)
    first = 1000 + list(MIRRORS).index(name) * 100 + samples * WORLDS_PER_TABLE
    different, filled_tiles = [], 0.0
    for seed in range(first, first + WORLDS_PER_TABLE):
        world, state = make_random_exposure(seed)
        filled, traced, share = fill_and_trace(world, state, table)
        different += [seed] if (filled != traced).any() else []
        filled_tiles += share
    assert different == []
    # Else the comparison would compare nothing.
    assert filled_tiles / WORLDS_PER_TABLE > 0.2


# The nearest are behind some rays' origins, and before the apexes of others' beams.
@pytest.mark.parametrize("distance_m", [0.02, 0.04, 0.07, 0.12, 0.2, 0.5, 1.0, 5.0])
@pytest.mark.parametrize("name", MIRRORS)
def test_image_of_near_things_when_filled_is_the_traced_one(name: str, distance_m: float) -> None:
    world = make_near_world(distance_m)
    for width_px, samples in ((120, 1), (64, 2)):
        table = make_table(name, width_px=width_px, samples=samples)
        assert count_differences(world, CAMERA_STATE, table) == 0


@pytest.mark.parametrize("name", MIRRORS)
def test_image_of_objects_when_filled_is_the_traced_one(name: str) -> None:
    table = make_table(name, width_px=72, samples=2)
    world = scenes.make_worlds()["field"]
    # The last one around the mirror, whose rays begin within it.
    cubes = (place_cube(0.5, 0.3, -0.45, size_m=0.3), place_cube(0.5, 0.3, -0.6, size_m=0.3))
    for objects in (TWO_ROBOTS, cubes[:1], cubes[1:]):
        state = replace(scenes.CAMERA_STATE, objects=objects)
        assert count_differences(world, state, table) == 0


@pytest.mark.parametrize("name", MIRRORS)
def test_image_of_an_object_beside_the_mirror_when_filled_is_the_traced_one(name: str) -> None:
    # Between the viewpoint and the rays' origins: sides face these that do not face the former.
    table = make_table(name, width_px=72, samples=1)
    world, (x, y, z) = make_test_world(), CAMERA_STATE.world_from_mirror.translation
    with open_kernel(world) as engine:
        rays = engine.prepare(table)
        for offset_m in np.linspace(-0.08, 0.08, 17):
            for axis in range(3):
                centre = np.array((x, y, z))
                centre[axis] += offset_m
                state = replace(CAMERA_STATE, objects=(place_cube(*centre, size_m=0.05),))
                filled, traced, _ = render_filled_and_traced(engine, rays, state)
                np.testing.assert_array_equal(filled, traced)


@pytest.mark.parametrize("name", MIRRORS)
def test_image_far_from_the_scene_s_centre_when_filled_is_the_traced_one(name: str) -> None:
    table = make_table(name, width_px=72, samples=1)
    for centre_m in (40.0, 600.0, 2e5):
        field = Item("far", Rectangle((2.0, 2.0)), Pose.from_rpy((2.0 * centre_m, 0.0, 0.0)), GREY)
        world = make_test_world()
        world = replace(world, items=(*world.items, field))
        filled, traced, share = fill_and_trace(world, CAMERA_STATE, table)
        assert share > 0.1
        assert not level_differences(filled, traced).any()


@pytest.mark.parametrize("name", MIRRORS)
def test_textures_and_lamps_when_filled_differ_by_one_level_from_the_traced_ones(
    name: str, tmp_path: Path
) -> None:
    texture = write_smooth_texture(tmp_path / "waves.png")
    worlds = (
        make_test_world(texture=texture, lights=(HEMISPHERE_LIGHT, POINT_LIGHT)),
        read_world(scenes.CORRIDOR)[0],
    )
    table = make_table(name, width_px=72, samples=2)
    for world in worlds:
        filled, traced, share = fill_and_trace(world, CAMERA_STATE, table)
        assert level_differences(filled, traced).max() <= 1
        assert share > 0.2


@pytest.mark.parametrize("name", MIRRORS)
def test_shadows_when_filled_differ_by_one_level_from_the_traced_ones(name: str) -> None:
    table = make_table(name, width_px=72, samples=2)
    lamp = PointLight((0.4, -0.5, -1.4), (0.9, 0.7, 0.4))
    world = replace(make_test_world(), lights=(*make_test_world().lights, lamp))
    for objects in ((), TWO_ROBOTS):
        state = replace(CAMERA_STATE, objects=objects, has_shadows=True)
        filled, traced, _ = fill_and_trace(world, state, table)
        assert level_differences(filled, traced).max() <= 1


@pytest.mark.parametrize("name", MIRRORS)
def test_fog_textures_and_ranges_when_filled_are_the_traced_ones(name: str, tmp_path: Path) -> None:
    table = make_table(name, width_px=72, samples=2)
    textured = make_test_world(texture=write_smooth_texture(tmp_path / "waves.png"))
    foggy = replace(CAMERA_STATE, fog=FogMedium(0.2, (0.5, 0.5, 0.5)))
    request = TraceRequest(is_linear=True, has_ranges=True)
    for world, state in ((make_test_world(), foggy), (textured, CAMERA_STATE)):
        with open_kernel(world) as engine:
            rays = engine.prepare(table)
            filled = rays.render(state, request)
            assert rays.last_counts.num_filled_tiles > 0
            engine._scene.surfaces.num_surfaces = 0
            traced = rays.render(state, request)
        np.testing.assert_allclose(filled.image, traced.image, atol=2e-5)
        assert filled.range_m is not None
        assert traced.range_m is not None
        np.testing.assert_allclose(filled.range_m, traced.range_m, rtol=1e-4)


LINEAR = TraceRequest(
    is_linear=True,
    thresholds=dict.fromkeys(("MotionBlur", "RollingShutter"), Threshold(0.5)),
)
PASSING = driving_camera_state(CAMERA_STATE.world_from_mirror, 0.3, 60.0)
DRIVING = driving_camera_state(
    START_POSES["four_legged_2006"], 0.7, 40.0, crossing_object(START_POSES["four_legged_2006"])
)
T_S = 1.0 / 30.0
SHUTTERS = {
    "blurred": Shutter(T_S, 0.0, 64.0),
    "rolling": Shutter(0.0, T_S, 64.0),
    "both": Shutter(T_S, T_S, 64.0),
}


@pytest.mark.parametrize("name", MIRRORS)
def test_blur_is_the_mean_of_64_frames(name: str) -> None:
    setup = load_world_setup("four_legged_2006")
    with open_kernel(setup.world, scene=setup.scene, threads=2) as engine:
        rays = engine.prepare(make_table(name, width_px=200, samples=2))
        frame = rays.render(replace(DRIVING, shutter=SHUTTERS["blurred"]), LINEAR)
        frames = [
            rays.render_linear(camera_state_after(DRIVING, float(t))).astype(np.float64)
            for t in time_samples(T_S, 64)
        ]
    difference = np.abs(grey_levels(frame.image) - grey_levels(np.mean(frames, axis=0))).max(
        axis=-1
    )
    # As of mirrors with a viewpoint: test_engine_shutter.py.
    assert (difference > 2.0).mean() < 0.01 * 640 / 200
    assert (difference > 8.0).mean() < 0.001 * 640 / 200
    assert frame.changes["MotionBlur"].largest > 20.0


@pytest.mark.parametrize("name", MIRRORS)
def test_rows_are_those_of_sharp_frames_at_their_times(name: str) -> None:
    setup = load_world_setup("four_legged_2006")
    with open_kernel(setup.world, scene=setup.scene, threads=2) as engine:
        rays = engine.prepare(make_table(name, width_px=200, samples=2))
        image = rays.render(replace(DRIVING, shutter=SHUTTERS["rolling"]), LINEAR).image
        for row in range(3, 200, 31):
            time_s = T_S * ((row + 0.5) / 200 - 0.5)
            sharp = rays.render_linear(camera_state_after(DRIVING, time_s))[row]
            difference = np.abs(grey_levels(image[row]) - grey_levels(sharp)).max(axis=-1)
            assert (difference > 1.0).mean() < 0.02


@pytest.mark.parametrize("shutter", SHUTTERS)
@pytest.mark.parametrize("name", MIRRORS)
def test_exposure_when_filled_is_the_traced_one(name: str, shutter: str) -> None:
    table = make_table(name, width_px=72, samples=2)
    cases = ((scenes.make_worlds()["field"], DRIVING), (make_near_world(0.3), PASSING))
    for world, state in cases:
        filled, traced, _ = fill_and_trace(world, replace(state, shutter=SHUTTERS[shutter]), table)
        # What is known of a tile decides on the instants of its exposure, too.
        allowed = 0.0 if shutter == "rolling" else 0.005
        assert (level_differences(filled, traced) > 1).mean() <= allowed
