"""Which renderer is faster on this machine, and how good is what it shows?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/cost/questions/which_renderer.py

Prints, for 640 x 640 px in two scenes, the median and the least milliseconds of a frame with
read-back, and the RMSE in grey levels against 8 x 8 exact rays a pixel. Decided by it: `auto` in
render/choice.py traces where OpenGL is software.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
from scenes import EXPOSURE, camera, worlds

from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderWish, plan_from_wish
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.renderer import Image, Renderer, View
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene.meshes import build_scene

FRAMES = 25
REFERENCE_SAMPLES = 8

# name, samples along a pixel's side, face size in px (0 = the plan's own), face samples
TRACE = [("trace, 1 sample", 1, 0, 1), ("trace, 2 x 2", 2, 0, 1), ("trace, 3 x 3", 3, 0, 1)]
RASTER = [
    ("raster, 1 sample", 1, 0, 1),
    ("raster, 1 sample, faces of 4", 1, 0, 4),
    ("raster, 2 x 2", 2, 0, 1),
    ("raster, 2 x 2, faces of 4", 2, 0, 4),
    ("raster, 2 x 2, faces twice as wide", 2, 1312, 1),
    ("raster, 3 x 3, faces twice as wide", 3, 1312, 1),
]


def prepared(renderer: Renderer, samples: int, face_size_px: int, face_samples: int) -> View:
    wish = RenderWish(PerPixel(), samples, face_size_px, face_samples)
    plan = plan_from_wish(wish, camera(), kind=RendererKind.RASTER, why="measured")
    return renderer.prepare(camera(), plan)


def milliseconds(draw: Callable[[], object]) -> list[float]:
    times = []
    for _ in range(FRAMES):
        begin = time.perf_counter()
        draw()
        times.append(1e3 * (time.perf_counter() - begin))
    return times


def report(name: str, view: View, reference: Image) -> None:
    image = view.draw(EXPOSURE).rgb
    times = milliseconds(lambda: view.draw(EXPOSURE))
    rmse = np.sqrt(np.square(image.astype(float) - reference).mean())
    print(f"  {name:<36}{statistics.median(times):8.1f}{min(times):8.1f}{rmse:8.2f}")
    view.close()


def main() -> None:
    for title, world in worlds().items():
        scene = build_scene(world)
        trace, raster = TraceRenderer(scene, world), RasterRenderer(scene, world)
        print(f"{title}, {len(scene)} triangles\n  {trace.describe()}\n  {raster.describe()}")
        print(f"  {'':<36}{'median':>8}{'min':>8}{'rmse':>8}")
        view = prepared(trace, REFERENCE_SAMPLES, 0, 1)
        reference = view.draw(EXPOSURE).rgb
        for name, *numbers in TRACE:
            report(name, prepared(trace, *numbers), reference)
        for name, *numbers in RASTER:
            report(name, prepared(raster, *numbers), reference)
        raster.close()
        trace.close()


if __name__ == "__main__":
    main()
