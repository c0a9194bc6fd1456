"""What do faces of one size cost against parts of the picture's own density, and what do they show?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/cost/questions/face_parts.py

Prints, for 640 x 640 px in three scenes, the median milliseconds of a frame with read-back, on the
wall and of all processors, drawn in turns; the latter's ratio to faces of one size (1.01 picture
widths, which give a texel a pixel at any rim); and the RMSE in grey levels against 8 x 8 exact rays
a pixel. Decided by it: DEFAULT_TEXELS_PER_PX in plan/render_plan.py.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from interleaved import median_ms
from scenes import EXPOSURE, camera, worlds_and_a_million

from catoptra_server.plan.face_sizes import FacePart, parts_by_density, parts_of_size
from catoptra_server.plan.render_plan import PerPixel, RendererKind, RenderWish, plan_from_wish
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.renderer import RasterView
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import build_scene

ROUNDS = 25


def layouts() -> dict[str, tuple[FacePart, ...]]:
    """Return the parts that are compared, by name; the first is what the others are measured by."""
    shown = camera()
    parts = {"one size, 672 px": parts_of_size(shown.rim_rad, 672)}
    for texels in (1.0, 1.25, 1.5, 2.0):
        of_density = parts_by_density(shown, shown.rim_rad, texels_per_px=texels)
        parts[f"by density, {texels:g} texels a pixel"] = of_density
    return parts


def prepared(renderer: RasterRenderer, parts: tuple[FacePart, ...], samples: int) -> RasterView:
    plan = plan_from_wish(
        RenderWish(PerPixel(), samples), camera(), kind=RendererKind.RASTER, why="measured"
    )
    return renderer.prepare(camera(), replace(plan, face_parts=parts))


def reference(world: World) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    plan = plan_from_wish(
        RenderWish(PerPixel(), 8), camera(), kind=RendererKind.TRACE, why="measured"
    )
    renderer = TraceRenderer(build_scene(world), world)
    image = renderer.prepare(camera(), plan).draw(EXPOSURE).rgb.astype(float)
    renderer.close()
    return image


def report(
    world: World, samples: int, exact: np.ndarray[tuple[int, ...], np.dtype[np.float64]]
) -> None:
    renderer = RasterRenderer(build_scene(world), world)
    views = {name: prepared(renderer, parts, samples) for name, parts in layouts().items()}
    images = {name: view.draw(EXPOSURE).rgb for name, view in views.items()}
    draws = {name: lambda view=view: view.draw(EXPOSURE) for name, view in views.items()}
    times = median_ms(draws, rounds=ROUNDS)
    first = next(iter(times.values()))[1]
    for name, view in views.items():
        rmse = np.sqrt(np.square(images[name] - exact).mean())
        counts, (wall, processors) = view.face_counts, times[name]
        print(
            f"  {samples}^2 {name:<38}{wall:8.1f}{processors:8.1f}{processors / first:8.2f}"
            f"{rmse:8.2f}"
            f"{counts.texels / 1e6:8.2f} M texels{counts.triangles:9} triangles"
        )
        view.close()
    renderer.close()


def main() -> None:
    for title, world in worlds_and_a_million().items():
        print(f"{title}\n  {'':<42}{'wall':>8}{'CPU':>8}{'ratio':>8}{'rmse':>8}")
        exact = reference(world)
        for samples in (1, 2):
            report(world, samples, exact)


if __name__ == "__main__":
    main()
