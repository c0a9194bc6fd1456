"""Does raster's frame time depend on how many polygons the mirror has?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/polygon_counts.py

Prints the median milliseconds of frame and mirror pass for 16 to 4096 polygons and for the exact
law, drawn in turns. Drawing the mesh anew in every frame took software OpenGL the longer, the more
edges it had: it shades blocks of 4 x 4 samples once for each polygon in them, so that 4096 took
39 % more than 16. The mesh is therefore drawn once, into the places that its samples look up.
"""

from __future__ import annotations

import statistics

from scenes import CAMERA_STATE, make_camera, make_worlds

from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.render_plan import (
    PerPixel,
    RendererKind,
    RenderSettings,
    plan_from_settings,
)
from catoptra_server.render.renderer import RenderedImage
from catoptra_server.scene.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.scene.scene_mesh import build_scene

POLYGONS = (16, 64, 256, 1024, 4096)
SAMPLES = 2
ROUNDS = 60


def main() -> None:
    world = make_worlds()["field"]
    renderer = RasterRenderer(build_scene(world), world)
    surfaces = {str(count): tessellation_from_polygon_count(count) for count in POLYGONS} | {
        "exact law": PerPixel()
    }
    views = {}
    for name, surface in surfaces.items():
        wish = RenderSettings(surface, SAMPLES)
        plan = plan_from_settings(
            wish, make_camera(360), kind=RendererKind.RASTER, reason="measured"
        )
        views[name] = renderer.prepare(make_camera(360), plan)
    drawn: dict[str, list[RenderedImage]] = {name: [] for name in views}
    for _ in range(ROUNDS):
        for name, view in views.items():
            drawn[name].append(view.draw(CAMERA_STATE))
    print(f"{'polygons':>10}{'frame ms':>10}{'mirror ms':>10}")
    for name, images in drawn.items():
        frame = statistics.median(sum(image.stage_ms.values()) for image in images)
        mirror = statistics.median(image.stage_ms["mirror"] for image in images)
        print(f"{name:>10}{frame:>10.2f}{mirror:>10.2f}")


if __name__ == "__main__":
    main()
