"""What triangles that nobody looks at cost a frame, for ten times as many, and again.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/unseen_triangles.py

Prints the processor time of frames, in turns, over that of the frame with the fewest triangles:
median and quartiles. A ball lies behind a screen in a corner of the field, or in the open, where it
covers a few pixels; a dome of sky stands around it, of triangles that are larger than all others.
Decision: how the proofs find what may be in a part of the image,
render/trace/kernel/src/candidates.h.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scenes import CAMERA_STATE, FIELD, make_camera

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine, KernelRays
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    Item,
    Material,
    SphereBand,
    World,
)

WARM_UP = 3
GREY, SKY = Material((0.5, 0.5, 0.5)), Material((0.4, 0.6, 0.9), unlit=True)
# Sectors and rings of a ball or dome: twice their product is its number of triangles.
BALLS = ((100, 100), (317, 316), (1000, 1000))
DOMES = ((72, 36), (230, 115), (720, 360))


def make_ball(sectors: int, rings: int, *, is_hidden: bool) -> World:
    """The field with a ball in a corner."""
    corner = Pose.from_rpy((2.6, 1.6, -0.2))
    band = SphereBand(0.15, 0.001, math.pi - 0.001, sectors, rings)
    items = [Item("ball", band, corner, GREY)]
    if is_hidden:
        turned = Pose.from_rpy((2.2, 1.25, -0.3), (0.0, 0.0, math.atan2(1.3, 2.1)))
        items.append(Item("screen", Box((0.02, 0.8, 0.6)), turned, GREY))
    return _add_to_field(items)


def make_dome(sectors: int, rings: int) -> World:
    """The field under a dome."""
    dome = SphereBand(60.0, 0.5 * math.pi, math.pi - 0.001, sectors, rings)
    return _add_to_field([Item("sky", dome, Pose.identity(), SKY)])


def _add_to_field(items: list[Item]) -> World:
    world = read_world(FIELD)[0]
    return replace(world, items=(*world.items, *items))


def make_families() -> Iterator[tuple[str, list[World]]]:
    yield "hidden ball", [make_ball(*size, is_hidden=True) for size in BALLS]
    yield "ball in view", [make_ball(*size, is_hidden=False) for size in BALLS]
    yield "dome", [make_dome(*size) for size in DOMES]


def measure_ms(rays: KernelRays) -> float:
    begin = time.process_time()
    rays.render_srgb(CAMERA_STATE)
    return 1e3 * (time.process_time() - begin)


def print_rows(engines: list[KernelEngine], width_px: int, samples: int, rounds: int) -> None:
    camera = make_camera(width_px)
    plan = plan_from_settings(
        RenderSettings(samples=samples), camera, kind=RendererKind.TRACE, reason="measured"
    )
    views = [engine.prepare(omni_ray_table(camera, plan)) for engine in engines]
    rows = [[measure_ms(view) for view in views] for _ in range(WARM_UP + rounds)]
    times = np.array(rows[WARM_UP:])
    for view, ms, ratio in zip(views, times.T, (times / times[:, :1]).T, strict=True):
        low, middle, high = np.percentile(ratio, (25, 50, 75))
        share = view.last_counts.num_filled_tiles / view.last_counts.num_tiles
        print(
            f"  {width_px} px, {samples} x {samples}: {np.median(ms):6.2f} ms, {share:6.1%} filled,"
            f" x {middle:.3f} ({low:.3f} to {high:.3f})"
        )
        view.close()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=40)
    parser.add_argument("--sizes", type=int, nargs="*", default=[360, 640])
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    for title, worlds in make_families():
        engines = []
        for world in worlds:
            scene = build_scene(world, MemoryBudget(2**32))
            begin = time.perf_counter()
            engines.append(
                KernelEngine(scene, world, threads=arguments.threads, scene_lights=world.lights)
            )
            took = time.perf_counter() - begin
            print(f"{title}: {len(scene)} triangles, committed in {took:.2f} s")
        for width_px in arguments.sizes:
            for samples in (1, 2):
                print_rows(engines, width_px, samples, arguments.rounds)
        for engine in engines:
            engine.close()


if __name__ == "__main__":
    main()
