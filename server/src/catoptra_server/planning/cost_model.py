"""How long a frame takes by a plan, from a few frames that were measured: stage by stage.

A stage's time is a sum of rates times quantities of the plan: something fixed, and so much a ray,
a sample of the picture, a texel. The rates are fitted to measured frames of one scene, one camera
and one renderer; they say nothing of another machine.

| renderer | stage  | time goes with                                                      |
|----------|--------|---------------------------------------------------------------------|
| trace    | cells  | nothing that a plan chooses: corners of cells and outlines          |
| trace    | trace  | samples of the picture; all of them, or those that cells leave      |
| raster   | faces  | the scene's triangles (fixed), texels, further samples of texels    |
| raster   | mirror | samples of the picture, and texels: a larger atlas leaves the cache |
| any      | others | samples: averaging, read-back, what is between the stages           |
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.render.render_plan import RendererKind, RenderPlan

Rates = Mapping[str, tuple[float, ...]]  # ms a unit of each quantity, by stage

_PER_MILLION = 1e-6
# A stage this short is not worth an exact relative error.
_MIN_MS = 0.2


@dataclass(frozen=True, slots=True)
class PlanTiming:
    """A plan, and the milliseconds of each stage of its frames."""

    plan: RenderPlan
    stage_ms: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class CostModel:
    """The rates of one camera in one scene, by way of drawing (`cost_group`)."""

    camera: OmniCamera
    rates: Mapping[str, Rates]

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        """Return the predicted milliseconds of a frame. Raises KeyError for another way."""
        return sum(self.predict_stage_ms(plan).values())

    def predict_stage_ms(self, plan: RenderPlan) -> dict[str, float]:
        """Return the predicted milliseconds of each stage."""
        return {
            stage: float(np.dot(rates, cost_features(stage, plan, self.camera)))
            for stage, rates in self.rates[cost_group(plan)].items()
        }


def cost_group(plan: RenderPlan) -> str:
    """Return by which way a plan draws: what is measured of one says nothing of the others."""
    if plan.renderer is RendererKind.RASTER:
        return "raster"
    return "trace, rays apart" if plan.stride_px > 1 else "trace, every ray"


def cost_features(stage: str, plan: RenderPlan, camera: OmniCamera) -> tuple[float, ...]:
    """Return what a stage's time goes with: 1, and millions of things."""
    samples = _PER_MILLION * camera.width_px * camera.height_px * plan.samples**2
    texels = _PER_MILLION * sum(part.num_texels for part in plan.face_regions)
    match stage:
        case "cells":
            return (1.0,)
        case "faces":
            return 1.0, texels, texels * (plan.face_samples - 1)
        case "mirror":
            return 1.0, samples, texels
    return 1.0, samples


def fit_cost_model(camera: OmniCamera, timings: Iterable[PlanTiming]) -> CostModel:
    """Return the rates that come nearest to measured frames, in parts of their times."""
    by_way: dict[str, list[PlanTiming]] = {}
    for one in timings:
        by_way.setdefault(cost_group(one.plan), []).append(one)
    return CostModel(camera, {way: _fit_rates(camera, frames) for way, frames in by_way.items()})


def _fit_rates(camera: OmniCamera, timings: list[PlanTiming]) -> Rates:
    return {
        stage: fit_nonnegative_rates(
            np.array([cost_features(stage, frame.plan, camera) for frame in timings]),
            np.array([frame.stage_ms.get(stage, 0.0) for frame in timings]),
        )
        for stage in sorted({stage for frame in timings for stage in frame.stage_ms})
    }


def fit_nonnegative_rates(features: Floats, ms: Floats) -> tuple[float, ...]:
    """Return the rates (k,), none negative, by which amounts (n, k) explain times (n,) best.

    There are at most three quantities: all choices of which are above 0 are tried. Of choices that
    explain as much the one with fewest quantities is taken, and of these one that grows: a single
    frame does not tell what was fixed.
    """
    weight = 1.0 / np.maximum(ms, _MIN_MS)
    rows, target = features * weight[:, None], ms * weight
    best, least = np.zeros(features.shape[1]), float(target @ target)
    for used in _index_subsets(features.shape[1]):
        rates = np.zeros(features.shape[1])
        rates[used] = np.linalg.lstsq(rows[:, used], target, rcond=None)[0]
        left = float(np.square(rows @ rates - target).sum())
        if (rates >= 0.0).all() and left < least - 1e-12:
            best, least = rates, left
    return tuple(float(rate) for rate in best)


def _index_subsets(count: int) -> Iterable[list[int]]:
    sizes = range(1, count + 1)
    last_first = range(count - 1, -1, -1)
    return [list(used) for size in sizes for used in itertools.combinations(last_first, size)]
