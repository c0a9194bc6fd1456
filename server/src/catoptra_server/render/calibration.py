"""A short measurement of what frames cost here: a few plans, a few frames of each, stage by stage.

It takes about a second a renderer on two cores; most of it is the preparing of views. The plans are
chosen so that every rate of `plan/cost_model` shows in one of them.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.plan.cost_model import Measured
from catoptra_server.plan.render_plan import (
    RendererKind,
    RenderPlan,
    RenderWish,
    Surface,
    plan_from_wish,
)
from catoptra_server.render.renderer import Exposure, Renderer, View

Clock = Callable[[], float]

# Of one plan: enough for a median, unless frames are so slow that a few must do.
_FRAMES = 7
_LEAST_FRAMES = 3
_LONGEST_S = 0.12
# The first frames find caches cold.
_WARM_UP = 2
# Samples, texels a pixel, samples a texel.
_RASTER = ((1, 0.5, 1), (2, 1.0, 1), (1, 1.5, 1), (1, 0.5, 4))
# Samples, and how far apart rays are; 0 = as planned.
_TRACE = ((1, 0), (2, 0), (1, 1))
REST = "rest"


def measured(
    renderer: Renderer,
    kind: RendererKind,
    camera: OmniCamera,
    surface: Surface,
    exposures: Sequence[Exposure],
    *,
    clock: Clock = time.perf_counter,
) -> list[Measured]:
    """Return the median stage times of a few plans, each drawn from all the exposures in turn."""
    times = []
    for plan in plans_to_measure(kind, camera, surface):
        view = renderer.prepare(camera, plan)
        try:
            times.append(Measured(plan, _stage_ms(view, exposures, clock)))
        finally:
            view.close()
    return times


def plans_to_measure(
    kind: RendererKind, camera: OmniCamera, surface: Surface
) -> Iterator[RenderPlan]:
    """Iterate over the plans from which the costs of all others follow."""
    for variant in _variants(kind, surface):
        yield plan_from_wish(variant, camera, kind=kind, why="measured")


def _variants(kind: RendererKind, surface: Surface) -> Iterator[RenderWish]:
    wish = RenderWish(surface)
    if kind is RendererKind.RASTER:
        for samples, texels_per_px, face_samples in _RASTER:
            yield replace(
                wish,
                samples=samples,
                texels_per_px=texels_per_px,
                face_samples=face_samples,
            )
        return
    for samples, stride_px in _TRACE:
        yield replace(wish, samples=samples, stride_px=stride_px)


def _stage_ms(view: View, exposures: Sequence[Exposure], clock: Clock) -> dict[str, float]:
    turns = itertools.cycle(exposures)
    for _ in range(_WARM_UP):
        view.draw(next(turns))
    frames: list[dict[str, float]] = []
    begin_s = clock()
    while len(frames) < _FRAMES:
        start_s = clock()
        stages = view.draw(next(turns)).stage_ms
        end_s = clock()
        frames.append({**stages, REST: max(0.0, 1e3 * (end_s - start_s) - sum(stages.values()))})
        if len(frames) >= _LEAST_FRAMES and end_s - begin_s > _LONGEST_S:
            break
    return {stage: statistics.median(frame[stage] for frame in frames) for stage in frames[0]}
