"""A short measurement of what frames cost here: a few plans, a few frames of each, stage by stage.

It takes about a second a renderer on two cores; most of it is the preparing of views. The plans are
chosen so that every rate of `planning/cost_model` shows in one of them.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.cost_model import PlanTiming
from catoptra_server.render.render_plan import (
    MirrorSurface,
    RendererKind,
    RenderPlan,
    RenderSettings,
    plan_from_settings,
)
from catoptra_server.render.renderer import Renderer, View

Clock = Callable[[], float]

# Of one plan: enough for a median, unless frames are so slow that a few must do.
_MAX_FRAMES = 7
_MIN_FRAMES = 3
_MAX_DURATION_S = 0.12
# The first frames find caches cold.
_NUM_WARM_UP_FRAMES = 2
# Samples, texels a pixel, samples a texel.
_RASTER_VARIANTS = ((1, 0.5, 1), (2, 1.0, 1), (1, 1.5, 1), (1, 0.5, 4))
# Samples, and how far apart rays are; 0 = as planned.
_TRACE_VARIANTS = ((1, 0), (2, 0), (1, 1))
OTHER_STAGES = "rest"


def measure_costs(
    renderer: Renderer,
    kind: RendererKind,
    camera: OmniCamera,
    surface: MirrorSurface,
    camera_states: Sequence[CameraState],
    *,
    clock: Clock = time.perf_counter,
) -> list[PlanTiming]:
    """Return the median stage times of a few plans, each drawn from all the exposures in turn."""
    times = []
    for plan in calibration_plans(kind, camera, surface):
        view = renderer.prepare(camera, plan)
        try:
            times.append(PlanTiming(plan, _measure_stages(view, camera_states, clock)))
        finally:
            view.close()
    return times


def calibration_plans(
    kind: RendererKind, camera: OmniCamera, surface: MirrorSurface
) -> Iterator[RenderPlan]:
    """Iterate over the plans from which the costs of all others follow."""
    for variant in _settings_variants(kind, surface):
        yield plan_from_settings(variant, camera, kind=kind, reason="measured")


def _settings_variants(kind: RendererKind, surface: MirrorSurface) -> Iterator[RenderSettings]:
    wish = RenderSettings(surface)
    if kind is RendererKind.RASTER:
        for samples, texels_per_px, face_samples in _RASTER_VARIANTS:
            yield replace(
                wish,
                samples=samples,
                texels_per_px=texels_per_px,
                face_samples=face_samples,
            )
        return
    for samples, stride_px in _TRACE_VARIANTS:
        yield replace(wish, samples=samples, stride_px=stride_px)


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
        frames.append(
            {**stages, OTHER_STAGES: max(0.0, 1e3 * (end_s - start_s) - sum(stages.values()))}
        )
        if len(frames) >= _MIN_FRAMES and end_s - begin_s > _MAX_DURATION_S:
            break
    return {stage: statistics.median(frame[stage] for frame in frames) for stage in frames[0]}
