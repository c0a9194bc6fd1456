"""Cost of other robots in a frame, and two methods to trace their meshes.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/dynamic_objects.py

Prints the median and the minimum milliseconds of a frame on the field with 0, 1, 4 and 16 robots in
view, in both renderers: 640 x 640 px of the mirror and 320 x 240 px of a perspective camera, 2 x 2
samples; then the time to prepare the perspective camera again, as a zoom does. Last, for 100 000
rays from the viewpoint on one thread, two methods for trace: a new commit of all meshes in each
frame, and rays transformed into each object's frame. Decision: render/trace/embree_objects.py
transforms the rays.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from scenes import CAMERA_STATE, ROBOT, make_camera, make_robots, make_worlds

from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.renderer_choice import create_renderer
from catoptra_server.render.renderer import Renderer, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes, intersect_objects
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.scene_mesh import build_scene

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


def compare_methods() -> None:
    """Print the times of a new commit, of rays cast in the committed scene, and of turned rays."""
    rng = np.random.default_rng(0)
    rays = rng.normal(size=(100_000, 3))
    rays[:, 2] = np.abs(rays[:, 2])
    rays = rays[
        np.argsort(np.arctan2(rays[:, 1], rays[:, 0]))
    ]  # adjacent rays in sequence, as in an image
    directions = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
    viewpoint = CAMERA_STATE.world_from_mirror.translation
    origins = np.broadcast_to(viewpoint.astype(np.float32), directions.shape)
    scale, scenes = SrgbScale.for_samples(4), EmbreeObjectScenes(make_worlds()["field"].lights)
    print(f"100 000 rays on one thread, {len(ROBOT)} triangles a robot")
    for count in COUNTS[1:]:
        robots = make_robots(count)

        def commit(robots: tuple[DynamicObject, ...] = robots) -> rtcore_scene.EmbreeScene:
            corners = [r.world_from_object.transform_points(r.mesh.corners) for r in robots]
            scene = rtcore_scene.EmbreeScene()
            TriangleMesh(scene, np.concatenate(corners).astype(np.float32))
            scene.run(origins[:1], directions[:1])
            return scene

        def turn_rays(robots: tuple[DynamicObject, ...] = robots) -> None:
            intersect_objects(scenes.place_objects(robots, viewpoint, scale), directions, scale)

        scene = commit()
        cast_ms = measure_ms(lambda s=scene: s.run(origins, directions, output=True))
        print(f"  {count:2d} robots committed anew".ljust(38), measure_ms(commit))
        print(f"  {count:2d} robots, rays cast".ljust(38), cast_ms)
        print(f"  {count:2d} robots, rays turned".ljust(38), measure_ms(turn_rays))


if __name__ == "__main__":
    measure_frames()
    compare_methods()
