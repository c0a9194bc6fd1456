"""The reference engine: bytes that depend on scene and rays alone; batches have every ray once."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.render.trace.reference import reference_engine as module
from catoptra_server.render.trace.reference.reference_engine import ReferenceEngine, mean_pixels
from catoptra_server.render.trace.trace_engine import NOTHING, STATIC_SCENE, assemble_grid
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import PointLight, World
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.worlds import (
    CAMERA_STATE,
    DIRECTIONAL_LIGHT,
    HEMISPHERE_LIGHT,
    POINT_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
    write_smooth_texture,
)


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_pixels_are_the_means_of_their_samples(samples: int) -> None:
    # The grid of samples, whose pixels are squares of samples x samples; in blocks of 4 x 4.
    side = 4 * samples
    grid = np.random.default_rng(2).uniform(size=(side, side))
    blocks = grid.reshape(samples, 4, samples, 4).swapaxes(1, 2).reshape(1, samples**2, 16, 1)
    expected = grid.reshape(4, samples, 4, samples).mean(axis=(1, 3))
    np.testing.assert_allclose(mean_pixels(blocks, samples)[0, ..., 0], expected)


LARGER_CAMERA = make_omni_camera(width_px=90)
EXPOSURE = replace(CAMERA_STATE, objects=TWO_ROBOTS, has_shadows=True)


def make_engine(world: World, *, threads: int = 1) -> ReferenceEngine:
    return ReferenceEngine(build_scene(world), world, threads=threads, scene_lights=world.lights)


@pytest.mark.parametrize("rays_per_batch", [1000, 5000, 2**20])
def test_image_does_not_depend_on_batches_and_threads(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, rays_per_batch: int
) -> None:
    world = make_test_world(
        lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT, POINT_LIGHT),
        texture=write_smooth_texture(tmp_path / "waves.png"),
    )
    table = omni_ray_table(LARGER_CAMERA, make_plan(LARGER_CAMERA, samples=2))
    whole = make_engine(world).prepare(table).render_linear(EXPOSURE)
    monkeypatch.setattr(module, "_RAYS_PER_BATCH", rays_per_batch)
    parts = make_engine(world, threads=3).prepare(table).render_linear(EXPOSURE)
    np.testing.assert_array_equal(whole, parts)


def test_scene_has_its_own_lights_and_objects_have_all_of_the_world() -> None:
    lamp = PointLight((0.5, 0.0, -1.0), (3.0, 3.0, 3.0))
    world = make_test_world(lights=(HEMISPHERE_LIGHT, lamp))
    table = omni_ray_table(LARGER_CAMERA, make_plan(LARGER_CAMERA))
    exposure = replace(CAMERA_STATE, objects=TWO_ROBOTS)
    images = []
    for lights in (world.lights, (HEMISPHERE_LIGHT,)):
        engine = ReferenceEngine(build_scene(world), world, threads=1, scene_lights=lights)
        rays = engine.prepare(table)
        images.append(rays.render_linear(exposure))
        numbers = rays.find_hits(exposure).object.astype(np.float32)
        engine.close()
    number = assemble_grid(table, numbers[..., None], fill=np.float32(NOTHING))[..., 0]
    differs = (np.abs(images[0] - images[1]) > 1e-3).any(axis=-1)
    assert differs[number == STATIC_SCENE].mean() > 0.5
    assert (number > STATIC_SCENE).sum() > 100
    assert not differs[number > STATIC_SCENE].any()


def test_description_names_the_engine() -> None:
    engine = make_engine(make_test_world(), threads=3)
    assert engine.description == "reference (NumPy float64)"
    engine.close()


def test_rays_take_no_more_memory_than_their_table() -> None:
    table = omni_ray_table(LARGER_CAMERA, make_plan(LARGER_CAMERA))
    assert make_engine(make_test_world()).prepare(table).memory_bytes == table.memory_bytes


def test_image_of_two_million_rays_takes_the_memory_of_a_few_batches() -> None:
    camera = make_omni_camera(width_px=720)
    table = omni_ray_table(camera, make_plan(camera, samples=2))
    rays = make_engine(World("w", (), background=(1.0, 1.0, 1.0))).prepare(table)
    tracemalloc.start()
    try:
        rays.render_srgb(CAMERA_STATE)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Tiles and image take 3 bytes a pixel each; all batches at once took 65 MB.
    assert peak < 25e6
