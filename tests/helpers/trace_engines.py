"""The engines of the trace renderer, for tests that hold for each of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, RayTable
from catoptra_server.render.trace.trace_engine import TracedExposure, TraceEngine
from catoptra_server.render.trace.trace_renderer import EngineName, create_engine
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World

AT_ORIGIN = CameraState(Pose.identity())

ENGINES: tuple[EngineName, ...] = ("kernel", "reference")


@contextmanager
def open_engine(
    name: EngineName, world: World, *, scene: SceneMesh | None = None, threads: int = 2
) -> Iterator[TraceEngine]:
    """An engine with a world; skips the test where the kernel cannot run."""
    try:
        _, engine = create_engine(
            name,
            build_scene(world) if scene is None else scene,
            world,
            threads=threads,
            scene_lights=world.lights,
        )
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    yield engine
    engine.close()


@contextmanager
def open_renderer(name: EngineName, world: World, *, threads: int = 1) -> Iterator[TraceRenderer]:
    """A trace renderer with one engine; skips the test where the kernel cannot run."""
    try:
        renderer = TraceRenderer(build_scene(world), world, threads=threads, engine=name)
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    yield renderer
    renderer.close()


def make_row_table(
    directions: npt.ArrayLike,
    origins: npt.ArrayLike | None = None,
    times: npt.ArrayLike | None = None,
) -> RayTable:
    """Table of a row of pixels with one ray each, of (n, 3) directions, origins and (n,) times."""
    directions = np.atleast_2d(np.asarray(directions))
    count = len(directions)
    tiles = -(-count // 4)
    # Pixel i of the first row is ray i % 4 of tile i // 4.
    rays = BLOCK_RAYS * (np.arange(count) // 4) + np.arange(count) % 4
    valid = np.zeros(tiles * BLOCK_RAYS, dtype=np.int64)
    valid[rays] = 1
    return RayTable(
        width_px=count,
        height_px=1,
        samples=1,
        tiles=np.arange(tiles, dtype=np.int32),
        directions=_scatter(directions, rays, tiles, fill=(0.0, 0.0, 1.0)),
        valid=(valid.reshape(tiles, 1, -1) @ (1 << np.arange(BLOCK_RAYS))).astype(np.uint16),
        origins=None if origins is None else _scatter(origins, rays, tiles, fill=(0.0, 0.0, 0.0)),
        times=None if times is None else _scatter(times, rays, tiles, fill=(0.0,))[:, :, 0].copy(),
    )


def _scatter(
    values: npt.ArrayLike, rays: np.ndarray[tuple[int]], tiles: int, *, fill: tuple[float, ...]
) -> np.ndarray[tuple[int]]:
    """(tiles, 1, k, 16) blocks of the k values of each ray."""
    spread = np.tile(np.array(fill, dtype=np.float32), (tiles * BLOCK_RAYS, 1))
    spread[rays] = np.asarray(values).reshape(-1, len(fill))
    blocks = spread.reshape(tiles, 1, BLOCK_RAYS, len(fill)).swapaxes(-1, -2)
    return np.ascontiguousarray(blocks)


def render_rays(
    engine: EngineName,
    world: World,
    directions: npt.ArrayLike,
    origins: npt.ArrayLike | None = None,
    *,
    exposure: TracedExposure = AT_ORIGIN,
    times: npt.ArrayLike | None = None,
    scene: SceneMesh | None = None,
) -> Floats:
    """(n, 3) linear radiance along rays in the mirror frame."""
    with open_engine(engine, world, scene=scene) as opened:
        table = make_row_table(directions, origins, times)
        return opened.prepare(table).render_linear(exposure)[0].astype(np.float64)


def encode_rays(engine: EngineName, world: World, *rays: tuple[object, object]) -> list[list[int]]:
    """Greys of rays (origin, direction)."""
    origins, directions = zip(*rays, strict=True)
    with open_engine(engine, world) as opened:
        rays_of_engine = opened.prepare(make_row_table(directions, origins, None))
        greys: list[list[int]] = rays_of_engine.render_srgb(AT_ORIGIN)[0].tolist()
    return greys


def measure_rays(
    engine: EngineName,
    world: World,
    directions: npt.ArrayLike,
    *,
    exposure: TracedExposure = AT_ORIGIN,
    times: npt.ArrayLike | None = None,
) -> Floats:
    """(n,) distances along rays from the viewpoint."""
    with open_engine(engine, world) as opened:
        hits = opened.prepare(make_row_table(directions, None, times)).find_hits(exposure)
    count = len(np.atleast_2d(np.asarray(directions)))
    return hits.range_m[:, 0, :4].reshape(-1)[:count].astype(np.float64)
