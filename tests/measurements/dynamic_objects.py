"""Cost of other robots in a frame.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/dynamic_objects.py

Prints the median and the minimum milliseconds of a frame on the field with 0, 1, 4 and 16 robots in
view, in both renderers: 640 x 640 px of the mirror and 320 x 240 px of a perspective camera, 2 x 2
samples; then the time to prepare the perspective camera again, as a zoom does. Decision: trace
moves instances of committed meshes, raster has one dynamic buffer.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

from scenes import CAMERA_STATE, make_camera, make_robots, make_worlds

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.renderer import Renderer, RenderSettings, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene

FRAMES = 25
COUNTS = (0, 1, 4, 16)
PERSPECTIVE = PerspectiveCamera(320, 240, math.radians(80.0))


def measure_ms(run: Callable[[], object]) -> str:
    """Median and minimum time in milliseconds, formatted."""
    times = []
    for _ in range(FRAMES):
        begin = time.perf_counter()
        run()
        times.append(1e3 * (time.perf_counter() - begin))
    return f"{statistics.median(times):8.2f}{min(times):8.2f}"


def print_times(name: str, view: View) -> None:
    for count in COUNTS:
        camera_state = CameraState(CAMERA_STATE.world_from_mirror, make_robots(count))
        view.render(camera_state)
        print(
            f"  {name}, {count:2d} robots".ljust(38),
            measure_ms(lambda s=camera_state: view.render(s)),
        )


def prepare_zoom(renderer: Renderer) -> None:
    renderer.prepare_perspective(PERSPECTIVE, 2).close()


def measure_frames() -> None:
    world = make_worlds()["field"]
    scene = build_scene(world)
    plan = plan_from_settings(
        RenderSettings(samples=2), make_camera(), kind=RendererKind.RASTER, reason="measured"
    )
    for renderer in (
        create_renderer(RendererKind.TRACE, scene, world),
        create_renderer(RendererKind.RASTER, scene, world),
    ):
        print(renderer.describe(), f"\n  {'':<36}  median     min")
        print_times("mirror", renderer.prepare(make_camera(), plan))
        print_times("perspective", renderer.prepare_perspective(PERSPECTIVE, 2))
        print(
            f"  {'perspective, prepared anew':<36}", measure_ms(lambda r=renderer: prepare_zoom(r))
        )
        renderer.close()


if __name__ == "__main__":
    measure_frames()
