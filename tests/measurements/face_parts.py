"""Cost and error of cube faces of one size against regions with the image's own density.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/face_parts.py

Prints, for 640 x 640 px in three scenes, the median milliseconds of a frame with read-back, wall
time and all processors, rendered in turns; the latter's ratio to faces of one size (1.01 image
widths, which give a texel per pixel at any rim); and the RMSE in grey levels against 8 x 8 exact
rays per pixel. Decision: DEFAULT_TEXELS_PER_PX in frames/plan/faces.py.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from interleaved import median_ms
from scenes import CAMERA_STATE, make_camera, make_worlds_with_million_triangles

from catoptra_server.frames.plan.faces import face_regions
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.renderer import FaceRegion, PerPixel, Renderer, RenderSettings, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World

ROUNDS = 25


def part_layouts() -> dict[str, tuple[FaceRegion, ...]]:
    """Face regions to be compared, by name; the first is the reference of the ratios."""
    shown = make_camera()
    parts = {"one size, 672 px": face_regions(shown, shown.rim_rad, size_px=672, texels_per_px=1.0)}
    for texels in (1.0, 1.25, 1.5, 2.0):
        of_density = face_regions(shown, shown.rim_rad, size_px=0, texels_per_px=texels)
        parts[f"by density, {texels:g} texels a pixel"] = of_density
    return parts


def prepare_view(renderer: Renderer, parts: tuple[FaceRegion, ...], samples: int) -> View:
    plan = plan_from_settings(
        RenderSettings(PerPixel(), samples),
        make_camera(),
        kind=RendererKind.RASTER,
        reason="measured",
    )
    return renderer.prepare(make_camera(), replace(plan, face_regions=parts))


def render_reference(world: World) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    plan = plan_from_settings(
        RenderSettings(PerPixel(), 8), make_camera(), kind=RendererKind.TRACE, reason="measured"
    )
    renderer = create_renderer(RendererKind.TRACE, build_scene(world), world)
    image = renderer.prepare(make_camera(), plan).render(CAMERA_STATE).rgb.astype(float)
    renderer.close()
    return image


def print_errors(
    world: World, samples: int, exact: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
) -> None:
    renderer = create_renderer(RendererKind.RASTER, build_scene(world), world)
    views = {name: prepare_view(renderer, parts, samples) for name, parts in part_layouts().items()}
    images = {name: view.render(CAMERA_STATE).rgb for name, view in views.items()}
    draws = {name: lambda view=view: view.render(CAMERA_STATE) for name, view in views.items()}
    times = median_ms(draws, rounds=ROUNDS)
    first = next(iter(times.values()))[1]
    for name, view in views.items():
        rmse = np.sqrt(np.square(images[name] - exact).mean())
        counts, (wall, processors) = view.face_counts, times[name]
        print(
            f"  {samples}^2 {name:<38}{wall:8.1f}{processors:8.1f}{processors / first:8.2f}"
            f"{rmse:8.2f}"
            f"{counts.num_texels / 1e6:8.2f} M texels{counts.num_triangles:9} triangles"
        )
        view.close()
    renderer.close()


def main() -> None:
    for title, world in make_worlds_with_million_triangles().items():
        print(f"{title}\n  {'':<42}{'wall':>8}{'CPU':>8}{'ratio':>8}{'rmse':>8}")
        exact = render_reference(world)
        for samples in (1, 2):
            print_errors(world, samples, exact)


if __name__ == "__main__":
    main()
