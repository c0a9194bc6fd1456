"""Frame time of raster by the number of polygons of the mirror mesh.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/polygon_counts.py

Prints the median milliseconds of frame and mirror pass for 16 to 4096 polygons and for the exact
model, rendered in turns. Rasterized in every frame, the mesh took software OpenGL longer with more
edges: blocks of 4 x 4 samples are shaded once for each polygon in them, so that 4096 polygons took
39 % more than 16. Decision: the mesh is rasterized once, into the lookup map of the samples.
"""

from __future__ import annotations

import statistics

from scenes import CAMERA_STATE, make_camera, make_worlds

from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.renderer import PerPixel, RenderedImage, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import tessellation_from_polygon_count
from catoptra_server.world.scene_mesh import build_scene

POLYGONS = (16, 64, 256, 1024, 4096)
SAMPLES = 2
ROUNDS = 60


def main() -> None:
    world = make_worlds()["field"]
    renderer = create_renderer(RendererKind.RASTER, build_scene(world), world)
    surfaces = {str(count): tessellation_from_polygon_count(count) for count in POLYGONS} | {
        "exact model": PerPixel()
    }
    views = {}
    for name, surface in surfaces.items():
        settings = RenderSettings(surface, SAMPLES)
        plan = plan_from_settings(
            settings, make_camera(360), kind=RendererKind.RASTER, reason="measured"
        )
        views[name] = renderer.prepare(make_camera(360), plan)
    rendered: dict[str, list[RenderedImage]] = {name: [] for name in views}
    for _ in range(ROUNDS):
        for name, view in views.items():
            rendered[name].append(view.render(CAMERA_STATE))
    print(f"{'polygons':>10}{'frame ms':>10}{'mirror ms':>10}")
    for name, images in rendered.items():
        frame = statistics.median(sum(image.stage_ms.values()) for image in images)
        mirror = statistics.median(image.stage_ms["mirror"] for image in images)
        print(f"{name:>10}{frame:>10.2f}{mirror:>10.2f}")


if __name__ == "__main__":
    main()
