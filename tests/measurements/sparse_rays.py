"""Frame time and error of images whose uniform cells are filled without rays.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/sparse_rays.py

Prints, for 640 x 640 px, the median milliseconds of frames along a path for each side of the cells
(1 = every ray is traced), rendered in turns; then the number of pixels that differ from the image
with every ray, over all poses, and their largest difference in grey levels. Decision: the default
of RenderPlan.stride_px.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
from scenes import CORRIDOR, FIELD, make_balls, make_camera, make_thin_objects_world

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.world_file import read_world
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.renderer_choice import create_renderer
from catoptra_server.render.renderer import View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.scene.scene_mesh import build_scene
from catoptra_server.scene.world_description import World

STRIDES = (1, 2, 4, 6, 8)
WARM_UP_FRAMES = 5


def make_worlds() -> dict[str, World]:
    """Worlds with few and with many triangles, clustered and spread out."""
    return {
        "field": read_world(FIELD)[0],
        "corridor": read_world(CORRIDOR)[0],
        "fence": make_thin_objects_world(),
        "balls": make_balls(),
        "million in 30 balls": make_balls(sectors=200, rings=84),
        "million in 500 balls": make_balls(500),
    }


def make_poses(frames: int) -> list[Pose]:
    """Viewpoints on a path through the centre of a world, 0.6 m above the floor."""
    t = np.linspace(0.0, 12.0, frames)
    return [
        Pose.from_rpy((1.5 * np.sin(a), 0.6 * np.cos(1.3 * a), -0.6), (0.0, 0.0, 0.5 * a))
        for a in t
    ]


def render(view: View, pose: Pose) -> tuple[float, np.ndarray[tuple[int, int, int]]]:
    begin = time.perf_counter()
    image = view.render(CameraState(pose)).rgb
    return 1e3 * (time.perf_counter() - begin), image.astype(np.int16)


def print_errors(world: World, samples: int, frames: int) -> None:
    scene = build_scene(world)
    begin = time.perf_counter()
    trace = create_renderer(RendererKind.TRACE, scene, world)
    ready_s = time.perf_counter() - begin
    views = {}
    for stride in STRIDES:
        settings = RenderSettings(samples=samples, stride_px=stride)
        plan = plan_from_settings(
            settings, make_camera(), kind=RendererKind.TRACE, reason="measured"
        )
        views[stride] = trace.prepare(make_camera(), plan)
    for view in views.values():
        for pose in make_poses(WARM_UP_FRAMES):
            view.render(CameraState(pose))
    times: dict[int, list[float]] = {stride: [] for stride in STRIDES}
    different, largest = dict.fromkeys(STRIDES, 0), dict.fromkeys(STRIDES, 0)
    for pose in make_poses(frames):
        whole = None
        for stride, view in views.items():
            took, image = render(view, pose)
            times[stride].append(took)
            whole = image if whole is None else whole
            apart = np.abs(image - whole).max(axis=-1)
            different[stride] += np.count_nonzero(apart)
            largest[stride] = max(largest[stride], int(apart.max()))
    print(
        f"  {world.name}, {len(scene)} triangles, {samples} x {samples}, ready in {ready_s:.1f} s"
    )
    for stride in STRIDES:
        median = statistics.median(times[stride])
        share = different[stride] / frames / 640**2
        print(
            f"    {stride:2} px {median:7.1f} ms  x {median / statistics.median(times[1]):.2f}"
            f"   differ {share:.1e} of the pixels, by {largest[stride]} levels at most"
        )
    trace.close()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--samples", type=int, nargs="*", default=[1, 2])
    parser.add_argument("worlds", nargs="*", default=[])
    arguments = parser.parse_args()
    for title, world in make_worlds().items():
        if title in arguments.worlds or not arguments.worlds:
            print(title)
            for samples in arguments.samples:
                print_errors(world, samples, arguments.frames)


if __name__ == "__main__":
    main()
