"""Predicted against measured frame times of plans on this machine.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/predicted_times.py

For 640 x 640 px in three scenes: rates from the calibration plans at four poses, as the server
measures them, then for several candidate plans the median of frames along a circle, rendered right
after. Prints predicted and measured milliseconds and their quotient. Decision: the plans that
frames/plan/planner.py has measured, and the quantities of frames/plan/costs.py, which should
predict within 25 %. On a machine with other load only processor times are comparable: with
--processor-time all clocks count the processor time of all threads.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections.abc import Iterator
from dataclasses import replace

from scenes import CORRIDOR, make_camera, make_worlds

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.costs import fit_cost_model
from catoptra_server.frames.plan.planner import measure_costs
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.renderer import PerPixel, Renderer, RenderPlan, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene

FRAMES = 20
WARM_UP_FRAMES = 4
BASE = RenderSettings(PerPixel())
SETTINGS = {
    RendererKind.TRACE: [replace(BASE, samples=n) for n in (1, 2, 3, 4, 5)],
    RendererKind.RASTER: [
        replace(BASE, samples=n, texels_per_px=texels, face_samples=faces)
        for n, texels, faces in ((1, 0.75, 1), (2, 1.0, 1), (3, 2.0, 1), (2, 1.0, 4), (4, 1.0, 1))
    ],
}


def circle_path(frames: int) -> Iterator[CameraState]:
    """Yield camera states along a circle with a radius of half a metre, with two turns."""
    for index in range(frames):
        turn = 2.0 * math.pi * index / frames
        location_m = (0.5 * math.cos(turn), 0.5 * math.sin(turn), -0.6)
        yield CameraState(Pose.from_rpy(location_m, (0.0, 0.0, 2.0 * turn)))


def measure_ms(renderer: Renderer, plan: RenderPlan) -> float:
    """Median milliseconds of a frame along the path."""
    view = renderer.prepare(make_camera(), plan)
    times = []
    for camera_state in circle_path(WARM_UP_FRAMES + FRAMES):
        begin = time.perf_counter()
        view.render(camera_state)
        times.append(1e3 * (time.perf_counter() - begin))
    view.close()
    return statistics.median(times[WARM_UP_FRAMES:])


def print_predictions(kind: RendererKind, renderer: Renderer) -> list[float]:
    """Print a row a plan; quotients of predicted and measured times."""
    camera, quotients = make_camera(), []
    begin = time.perf_counter()
    states = tuple(circle_path(4))
    timings = measure_costs(
        renderer, kind, camera, PerPixel(), states, clock=lambda: time.perf_counter()
    )
    model = fit_cost_model(camera, timings)
    print(f"  {renderer.describe()}: calibrated in {time.perf_counter() - begin:.1f} s")
    for settings in SETTINGS[kind]:
        plan = plan_from_settings(settings, camera, kind=kind, reason="measured")
        predicted, measured = model.predict_frame_ms(plan), measure_ms(renderer, plan)
        quotients.append(predicted / measured)
        numbers = f"{predicted:8.1f}{measured:8.1f}{predicted / measured:8.2f}"
        print(f"    {plan.description:<70}{numbers}", flush=True)
    return quotients


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--processor-time", action="store_true")
    if parser.parse_args().processor_time:
        time.perf_counter = time.process_time
    quotients: list[float] = []
    for title, world in {**make_worlds(), "corridor": read_world(CORRIDOR)[0]}.items():
        scene = build_scene(world)
        print(f"{title}, {len(scene)} triangles: predicted, measured, quotient")
        for kind in RendererKind:
            renderer = create_renderer(kind, scene, world)
            quotients += print_predictions(kind, renderer)
            renderer.close()
    within = sum(0.8 <= quotient <= 1.25 for quotient in quotients)
    print(f"{within} of {len(quotients)} within 25 %, {min(quotients):.2f} to {max(quotients):.2f}")


if __name__ == "__main__":
    main()
