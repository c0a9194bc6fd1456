"""Tiles that the kernel proves to show one surface, and what the proof saves.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/filled_tiles.py

Prints, for 640 x 640 px along a path, the share of tiles of 4 x 4 pixels that are filled without a
ray, and the median processor milliseconds of one thread for a frame and for all of its rays in bare
packets, in turns. A frame that takes longer than its bare rays gains nothing by the proof.
Decision: when the kernel looks for surfaces that fill tiles, render/trace/kernel/src/coverage.c.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np
from scenes import CORRIDOR, FIELD, make_balls, make_camera, make_thin_objects_world

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine, KernelRays
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World

WARM_UP_FRAMES = 3


def make_worlds() -> dict[str, World]:
    """Worlds with few and with many triangles, clustered and spread out."""
    return {
        "field": read_world(FIELD)[0],
        "corridor": read_world(CORRIDOR)[0],
        "fence": make_thin_objects_world(),
        "balls": make_balls(),
        "million in 30 balls": make_balls(sectors=200, rings=84),
        "million in 500 balls": make_balls(500),
    }


def make_states(frames: int) -> list[CameraState]:
    """Viewpoints on a path through the centre of a world, 0.6 m above the floor."""
    t = np.linspace(0.0, 12.0, frames)
    poses = (
        Pose.from_rpy((1.5 * np.sin(a), 0.6 * np.cos(1.3 * a), -0.6), (0.0, 0.0, 0.5 * a))
        for a in t
    )
    return [CameraState(pose) for pose in poses]


def measure_ms(render: Callable[[CameraState], object], state: CameraState) -> float:
    """Processor milliseconds of one frame."""
    begin = time.process_time()
    render(state)
    return 1e3 * (time.process_time() - begin)


def print_row(rays: KernelRays, samples: int, frames: int) -> None:
    for state in make_states(WARM_UP_FRAMES):
        rays.render_srgb(state)
    times: list[tuple[float, float]] = []
    filled, tiles = 0, 0
    for state in make_states(frames):
        frame_ms = measure_ms(rays.render_srgb, state)
        filled += rays.last_counts.num_filled_tiles
        tiles += rays.last_counts.num_tiles
        times.append((frame_ms, measure_ms(rays.trace_bare, state)))
    frame, bare = (statistics.median(row) for row in zip(*times, strict=True))
    print(
        f"  {samples} x {samples}: {filled / tiles:6.1%} of the tiles filled, "
        f"{frame:6.1f} ms, bare rays {bare:6.1f} ms, x {frame / bare:.2f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--samples", type=int, nargs="*", default=[1, 2, 4])
    parser.add_argument("worlds", nargs="*", default=[])
    arguments = parser.parse_args()
    camera = make_camera()
    for title, world in make_worlds().items():
        if arguments.worlds and title not in arguments.worlds:
            continue
        scene = build_scene(world)
        engine = KernelEngine(scene, world, threads=1, scene_lights=world.lights)
        print(f"{title}, {len(scene)} triangles, {engine.description}")
        for samples in arguments.samples:
            plan = plan_from_settings(
                RenderSettings(samples=samples), camera, kind=RendererKind.TRACE, reason="measured"
            )
            rays = engine.prepare(omni_ray_table(camera, plan))
            print_row(rays, samples, arguments.frames)
            rays.close()
        engine.close()


if __name__ == "__main__":
    main()
