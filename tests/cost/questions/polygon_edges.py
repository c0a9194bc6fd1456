"""Why does the mirror's pass take longer with more polygons on software OpenGL?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/cost/questions/polygon_edges.py

Prints the median milliseconds of the mirror's pass for meshes of 8 x 8 to 128 x 128 polygons in
pictures of 360 and 720 px, drawn in turns; and the least squares fit of what it may grow with: the
pixels (width squared), the length of all edges in pixels (width times the root of the count), and
the polygons (vertices, set-up). The report of `make cost` tells its result.
"""

from __future__ import annotations

import statistics

import numpy as np
from scenes import EXPOSURE, camera, worlds

from catoptra_server.plan.render_plan import RendererKind, RenderWish, plan_from_wish
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.renderer import View
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.mirror_mesh import PolygonSplit

WIDTHS_PX = (360, 720)
SIDES = (8, 16, 32, 64, 128)
ROUNDS = 30


def prepared(renderer: RasterRenderer, width_px: int, side: int) -> View:
    wish = RenderWish(PolygonSplit(side, side), 1)
    plan = plan_from_wish(wish, camera(width_px), kind=RendererKind.RASTER, why="measured")
    return renderer.prepare(camera(width_px), plan)


def mirror_ms(views: list[View]) -> list[float]:
    """Return the median of the mirror's stage for each view."""
    times = [[view.draw(EXPOSURE).stage_ms["mirror"] for view in views] for _ in range(ROUNDS)]
    return [statistics.median(of_view) for of_view in zip(*times, strict=True)]


def main() -> None:
    world = worlds()["field"]
    renderer = RasterRenderer(build_scene(world), world)
    cases = [(width, side) for width in WIDTHS_PX for side in SIDES]
    took = mirror_ms([prepared(renderer, *case) for case in cases])
    width, side = np.array(cases, dtype=float).T
    causes = np.stack((width**2, width * side, side**2), axis=1)
    share, *_ = np.linalg.lstsq(causes, np.array(took), rcond=None)
    print(f"{'':>16}{'ms':>8}{'pixels':>8}{'edges':>8}{'polygons':>9}{'fit':>8}")
    for case, ms, parts in zip(cases, took, causes * share, strict=True):
        told = "".join(f"{part:8.2f}" for part in parts)
        print(f"{case[0]:>6} px {case[1]:>3}^2 {ms:8.2f}{told} {parts.sum():8.2f}")


if __name__ == "__main__":
    main()
