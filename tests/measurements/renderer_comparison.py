"""Frame time and error of both renderers on this machine.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/renderer_comparison.py

Prints, for 640 x 640 px in three scenes, the median milliseconds of a frame with read-back, wall
time and all processors, rendered in turns, and the RMSE in grey levels against 8 x 8 exact rays per
pixel. Decision: the choice of `auto` in planning/renderer_choice.py where OpenGL is software.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from interleaved import median_ms
from scenes import CAMERA_STATE, CORRIDOR, make_camera, make_worlds

from catoptra_server.config.world_file import read_world
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.renderer_choice import create_renderer
from catoptra_server.render.renderer import Renderer, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import PerPixel, RenderSettings
from catoptra_server.scene.scene_mesh import build_scene

ROUNDS = 15
REFERENCE_SAMPLES = 8

# name, samples along a pixel's side, face size in px (0 = by the plan), face samples
TRACE = [(f"trace, {n} x {n}", n, 0, 1) for n in (1, 2, 3, 4)]
RASTER = [
    *((f"raster, {n} x {n}", n, 0, 1) for n in (1, 2, 3, 4)),
    ("raster, 2 x 2, faces of 4", 2, 0, 4),
    ("raster, 2 x 2, faces twice as wide", 2, 1312, 1),
]


def prepare_view(
    renderer: Renderer, kind: RendererKind, samples: int, face_size_px: int, face_samples: int
) -> View:
    settings = RenderSettings(PerPixel(), samples, face_size_px, face_samples)
    return renderer.prepare(
        make_camera(), plan_from_settings(settings, make_camera(), kind=kind, reason="measured")
    )


def print_costs(trace: Renderer, raster: Renderer) -> None:
    view = prepare_view(trace, RendererKind.TRACE, REFERENCE_SAMPLES, 0, 1)
    reference = view.render(CAMERA_STATE).rgb.astype(float)
    view.close()
    views = {name: prepare_view(trace, RendererKind.TRACE, *numbers) for name, *numbers in TRACE}
    for name, *numbers in RASTER:
        views[name] = prepare_view(raster, RendererKind.RASTER, *numbers)
    draws = {name: partial(view.render, CAMERA_STATE) for name, view in views.items()}
    for name, (wall, processors) in median_ms(draws, rounds=ROUNDS).items():
        image = views[name].render(CAMERA_STATE).rgb
        rmse = np.sqrt(np.square(image - reference).mean())
        print(f"  {name:<36}{wall:8.1f}{processors:8.1f}{rmse:8.2f}")
    for view in views.values():
        view.close()


def main() -> None:
    for title, world in {**make_worlds(), "corridor": read_world(CORRIDOR)[0]}.items():
        scene = build_scene(world)
        trace, raster = (
            create_renderer(RendererKind.TRACE, scene, world),
            create_renderer(RendererKind.RASTER, scene, world),
        )
        print(f"{title}, {len(scene)} triangles\n  {trace.describe()}\n  {raster.describe()}")
        print(f"  {'':<36}{'wall':>8}{'proc.':>8}{'rmse':>8}")
        print_costs(trace, raster)
        raster.close()
        trace.close()


if __name__ == "__main__":
    main()
