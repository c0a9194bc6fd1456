"""Bare rays a second of each packet width, by instruction set.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/packet_widths.py

Prints, for 640 x 640 px on the field, in clutter and in a million triangles, the millions of rays a
second that the kernel traces without any use of the hits, for single rays and packets of 4, 8 and
16, coherent and in tiles of 4 x 4 pixels, in turns; for each instruction set that the processor
has. By processor time of one thread, so that other load does not count. Decision: the width that
the kernel takes by default.
"""

from __future__ import annotations

import statistics
import time

from scenes import CAMERA_STATE, make_camera, make_worlds_with_million_triangles

from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine
from catoptra_server.render.trace.kernel.library import (
    PACKET_WIDTHS,
    KernelUnavailableError,
    available_instruction_sets,
)
from catoptra_server.render.trace.ray_table import RayTable, omni_ray_table
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World

ROUNDS = 9


def make_rays() -> RayTable:
    """One ray through the centre of each pixel of the paper's camera."""
    settings, camera = RenderSettings(samples=1), make_camera()
    kind = RendererKind.TRACE
    return omni_ray_table(camera, plan_from_settings(settings, camera, kind=kind, reason="rates"))


def count_rays(rays: RayTable) -> int:
    """Number of rays that see the mirror."""
    return sum(int(block).bit_count() for block in rays.valid.reshape(-1).tolist())


def measure_rates(scene: SceneMesh, world: World, instruction_set: str) -> dict[int, float]:
    """Millions of rays a second of each packet width, on one thread."""
    rays = make_rays()
    engines = {
        width: KernelEngine(
            scene,
            world,
            threads=1,
            scene_lights=world.lights,
            instruction_set=instruction_set,
            packet_width=width,
        )
        for width in PACKET_WIDTHS
    }
    views = {width: engine.prepare(rays) for width, engine in engines.items()}
    times: dict[int, list[float]] = {width: [] for width in views}
    for _ in range(ROUNDS):
        for width, view in views.items():
            # The others' frames have displaced the scene from the caches.
            view.trace_bare(CAMERA_STATE)
            begin = time.process_time()
            view.trace_bare(CAMERA_STATE)
            times[width].append(time.process_time() - begin)
    for width, engine in engines.items():
        views[width].close()
        engine.close()
    return {width: 1e-6 * count_rays(rays) / statistics.median(row) for width, row in times.items()}


def main() -> None:
    for title, world in make_worlds_with_million_triangles().items():
        scene = build_scene(world)
        print(f"{title}, {len(scene)} triangles: millions of rays a second of one thread")
        for instruction_set in available_instruction_sets():
            try:
                rates = measure_rates(scene, world, instruction_set)
            except KernelUnavailableError as error:
                print(f"  {instruction_set:8} {error}")
                continue
            widths = "  ".join(f"{width:2}: {rate:5.1f}" for width, rate in rates.items())
            print(f"  {instruction_set:8} {widths}")


if __name__ == "__main__":
    main()
