"""Frame times of the renderers on this machine.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/renderer_comparison.py

Scenes with few, many and a million triangles, with textures, with point lights; 360, 640 and 1024
px; 1 to 4 samples along a pixel's side. For each the median time of a frame with read-back by the
kernel, by the reference where that is bearable, and by raster, rendered in turns: half the
processor time of all threads. On two cores that is the wall time of a frame that keeps both at
work, and it is comparable on a machine with other load. Decision: frames/renderers.py,
which takes the kernel wherever no graphics processor is.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

from interleaved import median_ms
from scenes import CAMERA_STATE, CORRIDOR, FIELD, make_balls, make_camera

from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.renderer import PerPixel, Renderer, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import PointLight, World

IMAGES = ((360, 1), (360, 2), (640, 1), (640, 2), (640, 3), (640, 4), (1024, 1), (1024, 2))
# A frame of the reference takes up to a second a sample of each pixel.
REFERENCE_IMAGES = ((360, 1), (360, 2), (640, 1))
KERNEL, REFERENCE, RASTER = "kernel", "reference", "raster"
LAMPS = tuple(PointLight((x, 0.5, -2.0), (1.0, 0.9, 0.8)) for x in (-1.0, 1.0))


@dataclass(frozen=True, slots=True)
class MeasuredFrame:
    """A frame of one engine."""

    title: str
    engine: str
    side_px: int
    samples: int
    frame_ms: float


def make_worlds() -> Iterator[tuple[str, World]]:
    field, corridor = read_world(FIELD)[0], read_world(CORRIDOR)[0]
    yield "field", field
    yield "corridor", corridor
    yield "balls", make_balls()
    yield "field, 2 lamps", replace(field, lights=(*field.lights, *LAMPS))
    yield "corridor, 2 lamps", replace(corridor, lights=(*corridor.lights, *LAMPS))
    yield "million", make_balls(500)


def make_renderers(mesh: SceneMesh, world: World) -> dict[str, Renderer]:
    return {
        KERNEL: TraceRenderer(mesh, world, engine="kernel"),
        REFERENCE: TraceRenderer(mesh, world, engine="reference"),
        RASTER: RasterRenderer(mesh, world),
    }


def measure_image(
    title: str, world: World, mesh: SceneMesh, side_px: int, samples: int, rounds: int
) -> Iterator[MeasuredFrame]:
    """Measure one image by all engines, in turns."""
    camera, settings = make_camera(side_px), RenderSettings(PerPixel(), samples)
    renderers, draws = make_renderers(mesh, world), {}
    for engine, renderer in renderers.items():
        is_reference = engine is REFERENCE
        if is_reference and ((side_px, samples) not in REFERENCE_IMAGES or len(mesh) > 100_000):
            continue
        is_raster = engine is RASTER
        kind = RendererKind.RASTER if is_raster else RendererKind.TRACE
        view = renderer.prepare(
            camera, plan_from_settings(settings, camera, kind=kind, reason="measured")
        )
        draws[engine] = partial(view.render, CAMERA_STATE)
    for name, (_, processor_ms) in median_ms(draws, rounds=rounds).items():
        yield MeasuredFrame(title, name, side_px, samples, 0.5 * processor_ms)
    for renderer in renderers.values():
        renderer.close()


def print_choices(frames: list[MeasuredFrame]) -> None:
    """Print in how many cases raster is faster than the kernel, and by how much."""
    cases: dict[tuple[str, int, int], dict[str, float]] = {}
    for frame in frames:
        cases.setdefault((frame.title, frame.side_px, frame.samples), {})[frame.engine] = (
            frame.frame_ms
        )
    for (title, side_px, samples), ms in cases.items():
        if ms[RASTER] < ms[KERNEL]:
            gain = ms[KERNEL] / ms[RASTER]
            print(
                f"  {title}, {side_px} px, {samples} x {samples}: raster {gain:.2f} times as fast"
            )
    slower = sum(ms[RASTER] < ms[KERNEL] for ms in cases.values())
    print(f"the kernel is the faster one in {len(cases) - slower} of {len(cases)} cases")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    rounds, frames = parser.parse_args().rounds, list[MeasuredFrame]()
    for title, world in make_worlds():
        mesh = build_scene(world)
        print(f"{title}, {len(mesh)} triangles")
        for side_px, samples in IMAGES:
            row = list(measure_image(title, world, mesh, side_px, samples, rounds))
            times = ", ".join(f"{one.engine} {one.frame_ms:.1f}" for one in row)
            print(f"  {side_px:5} px {samples} x {samples}: {times}", flush=True)
            frames += row
    print_choices(frames)


if __name__ == "__main__":
    main()
