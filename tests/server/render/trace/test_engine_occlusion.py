"""Ambient occlusion in both engines: hemisphere light alone, by the float64 factors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.trace_renderer import EngineName
from catoptra_server.world.objects import CameraState, FogMedium, Shutter
from catoptra_server.world.shading import facet_irradiance, point_irradiance
from catoptra_server.world.world_description import Light, World
from helpers.image_comparison import level_differences
from helpers.standing_things import SKY, bake_scene, make_box_world
from helpers.trace_engines import ENGINES, render_rays
from helpers.trace_kernels import make_omni_table, open_kernel, render_filled_and_traced
from helpers.worlds import DIRECTIONAL_LIGHT, POINT_LIGHT, make_test_world

# Beside the box, whose middle is the origin.
ABOVE = CameraState(Pose.from_rpy((1.5, 1.0, -1.0)))
FLOOR_POINTS = np.array([(0.3, 0.1, 0.0), (0.35, 0.2, 0.0), (0.1, 0.3, 0.0), (2.0, 1.0, 0.0)])


def look_at_floor(engine: EngineName, world: World, state: CameraState) -> Floats:
    directions = FLOOR_POINTS - state.world_from_mirror.translation
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    return render_rays(engine, world, directions, exposure=state, scene=bake_scene(world))


def expect(world: World, lights: tuple[Light, ...]) -> Floats:
    """Radiance of the floor: factor times sky, and all of the other lights."""
    occlusion = bake_scene(world).occlusion
    assert occlusion is not None
    normals = np.tile([0.0, 0.0, -1.0], (len(FLOOR_POINTS), 1))
    factors = occlusion.factors(np.zeros(len(FLOOR_POINTS), dtype=int), FLOOR_POINTS)[:, 0]
    assert factors[0] < 0.9
    assert factors[-1] == 1.0
    total = factors[:, None] * facet_irradiance((SKY,), normals)
    total += facet_irradiance(lights, normals)
    return 0.5 * (total + point_irradiance(lights, FLOOR_POINTS, normals))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("lights", [(), (DIRECTIONAL_LIGHT,), (POINT_LIGHT, DIRECTIONAL_LIGHT)])
def test_factor_scales_hemisphere_light_alone(
    engine: EngineName, lights: tuple[Light, ...]
) -> None:
    world = make_box_world(lights=(SKY, *lights))
    np.testing.assert_allclose(
        look_at_floor(engine, world, ABOVE), expect(world, lights), atol=2e-5
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_factor_holds_under_shadows(engine: EngineName) -> None:
    overhead = replace(DIRECTIONAL_LIGHT, direction=(0.0, 0.0, 1.0))
    world = make_box_world(lights=(SKY, overhead))
    state = replace(ABOVE, has_shadows=True)
    # The box's shadow is its foot: the floor around it is lit.
    seen = look_at_floor(engine, world, state)
    np.testing.assert_allclose(seen, expect(world, (overhead,)), atol=2e-5)


@pytest.mark.parametrize("has_shadows", [False, True])
@pytest.mark.parametrize("samples", [1, 2])
def test_filled_tiles_show_what_rays_show(has_shadows: bool, samples: int) -> None:
    world = make_test_world()
    state = CameraState(
        Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3)), has_shadows=has_shadows
    )
    with open_kernel(world, scene=bake_scene(world)) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=samples))
        filled, traced, share = render_filled_and_traced(engine, rays, state)
    assert share > 0.3
    # A pixel's centre in place of its samples' mean, on either side of half a grey level.
    assert level_differences(filled, traced).max() <= 1


def test_open_parts_are_the_same_to_the_last_bit() -> None:
    world = make_box_world()
    with open_kernel(world) as plain, open_kernel(world, scene=bake_scene(world)) as occluded:
        images = []
        for engine in (plain, occluded):
            images.append(engine.prepare(make_omni_table(width_px=240)).render_linear(ABOVE))
    same = (images[0] == images[1]).all(axis=-1)
    assert 0.5 < same.mean() < 0.999


def test_threads_give_the_same_bytes() -> None:
    world = make_test_world()
    images = []
    for threads in (1, 2):
        scene = bake_scene(world, threads=threads)
        with open_kernel(world, scene=scene, threads=threads) as engine:
            images.append(
                engine.prepare(make_omni_table(width_px=240, samples=2)).render_srgb(ABOVE)
            )
    assert images[0].tobytes() == images[1].tobytes()


def test_fog_lies_before_occluded_floors() -> None:
    # Near enough that factors are taken at the centres of pixels.
    world = make_box_world()
    near = CameraState(Pose.from_rpy((0.5, 0.4, -0.4)), fog=FogMedium(0.6, (0.9, 0.6, 0.1)))
    with open_kernel(world, scene=bake_scene(world)) as engine:
        rays = engine.prepare(make_omni_table(width_px=480, samples=2))
        filled, traced, share = render_filled_and_traced(engine, rays, near)
    assert share > 0.3
    assert level_differences(filled, traced).max() <= 1


@pytest.mark.parametrize("samples", [1, 2])
def test_exposure_without_motion_is_the_sharp_frame_on_occluded_floors(samples: int) -> None:
    world = make_test_world()
    with open_kernel(world, scene=bake_scene(world)) as engine:
        rays = engine.prepare(make_omni_table(width_px=240, samples=samples))
        sharp = rays.render_linear(ABOVE)
        for shutter in (Shutter(0.05, 0.0, 64.0), Shutter(0.0, 0.05, 64.0)):
            moving = rays.render_linear(replace(ABOVE, shutter=shutter))
            np.testing.assert_allclose(moving, sharp, rtol=0.0, atol=1e-3)
