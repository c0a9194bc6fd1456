"""Native kernels for tests, with and without the proof that surfaces fill parts of an image."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine, KernelRays
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_table import RayTable, omni_ray_table
from catoptra_server.render.trace.trace_engine import TracedExposure
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from helpers.image_comparison import level_differences
from helpers.worlds import make_omni_camera, make_plan


@contextmanager
def open_kernel(
    world: World, *, scene: SceneMesh | None = None, threads: int = 1, **options: Any
) -> Iterator[KernelEngine]:
    """A kernel with a world; skips the test where no kernel can run."""
    scene = build_scene(world) if scene is None else scene
    try:
        engine = KernelEngine(scene, world, threads=threads, scene_lights=world.lights, **options)
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    yield engine
    engine.close()


def make_omni_table(*, width_px: int, samples: int = 1, rim_deg: float = 120.0) -> RayTable:
    """Rays of an omnidirectional camera whose mirror reaches any rim."""
    camera = make_omni_camera(mirror=ParabolicMirror(0.05), width_px=width_px, rim_deg=rim_deg)
    return omni_ray_table(camera, make_plan(camera, samples=samples))


def render_filled_and_traced(
    engine: KernelEngine, rays: KernelRays, exposure: TracedExposure
) -> tuple[Image, Image, float]:
    """The image with proven tiles filled, with all of them traced, and the share of the former."""
    filled = rays.render_srgb(exposure)
    share = rays.last_counts.num_filled_tiles / max(1, rays.last_counts.num_tiles)
    # The same rays to the last bit; those with times of their own are computed in other steps.
    surfaces = engine._scene.surfaces
    num_surfaces, surfaces.num_surfaces = surfaces.num_surfaces, 0
    traced = rays.render_srgb(exposure)
    surfaces.num_surfaces = num_surfaces
    assert rays.last_counts.num_filled_tiles == 0
    return filled, traced, share


def fill_and_trace(
    world: World, exposure: TracedExposure, table: RayTable
) -> tuple[Image, Image, float]:
    """The same of a world on a kernel of its own."""
    with open_kernel(world) as engine:
        return render_filled_and_traced(engine, engine.prepare(table), exposure)


def count_differences(world: World, state: CameraState, table: RayTable) -> int:
    """Number of pixels that differ between filled and traced tiles."""
    filled, traced, _ = fill_and_trace(world, state, table)
    return int(np.count_nonzero(level_differences(filled, traced)))
