"""Measured frame times of a few plans: median milliseconds of each stage, on this machine.

One to two seconds a renderer on two cores, most of it preparation of views. The plans come from
`candidate_plans`, the rates fitted to their times belong to `cost_model`.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Sequence

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.candidate_plans import generate_calibration_plans
from catoptra_server.planning.cost_model import PlanTiming
from catoptra_server.render.render_settings import MirrorSurface
from catoptra_server.render.renderer import Renderer, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.camera_state import CameraState

Clock = Callable[[], float]

# Nine frames give a stable median; slow frames stop at five, so that a million triangles at several
# samples do not hold up the first frame of a camera by seconds. Three were off by up to a half on a
# machine with other load.
_MAX_FRAMES = 9
_MIN_FRAMES = 5
_MAX_DURATION_S = 0.25
# The first frames find caches cold and, in raster, machine code to be compiled.
_NUM_WARM_UP_FRAMES = 2
# Wall time of a frame outside all stages.
OTHER_STAGES = "other"


def measure_costs(
    renderer: Renderer,
    kind: RendererKind,
    camera: OmniCamera,
    surface: MirrorSurface,
    camera_states: Sequence[CameraState],
    *,
    clock: Clock = time.perf_counter,
) -> list[PlanTiming]:
    """Measure the calibration plans of a renderer.

    Args:
        camera_states: States to render in turn, so that the times are of more than one viewpoint.
        clock: Monotonic seconds.
    """
    timings = []
    for plan in generate_calibration_plans(kind, camera, surface):
        view = renderer.prepare(camera, plan)
        try:
            timings.append(PlanTiming(plan, _measure_stages(view, camera_states, clock)))
        finally:
            view.close()
    return timings


def _measure_stages(
    view: View, camera_states: Sequence[CameraState], clock: Clock
) -> dict[str, float]:
    turns = itertools.cycle(camera_states)
    for _ in range(_NUM_WARM_UP_FRAMES):
        view.render(next(turns))
    frames: list[dict[str, float]] = []
    begin_s = clock()
    while len(frames) < _MAX_FRAMES:
        start_s = clock()
        stages = view.render(next(turns)).stage_ms
        end_s = clock()
        # Clamped: stages have clocks of their own, and rounding may take their sum above the wall
        # time.
        other_ms = max(0.0, 1e3 * (end_s - start_s) - sum(stages.values()))
        frames.append({**stages, OTHER_STAGES: other_ms})
        if len(frames) >= _MIN_FRAMES and end_s - begin_s > _MAX_DURATION_S:
            break
    return {stage: statistics.median(frame[stage] for frame in frames) for stage in frames[0]}
