"""Prediction of frame times: rates for each stage, fitted to a few measured frames.

A stage's time is a sum of rates times quantities of the plan: a constant, and so much a ray, a
sample, a texel. Rates hold for one scene, one camera and one renderer on one machine.

| renderer | stage  | time grows with                                                    |
|----------|--------|--------------------------------------------------------------------|
| trace    | trace  | samples, and their number along a side: along an edge of a surface |
|          |        | pixels take all samples, inside a surface the kernel takes few     |
| raster   | faces  | the scene's triangles (constant), texels, further samples a texel  |
| raster   | mirror | samples of the image, and texels: a larger atlas exceeds the cache |
| any      | other  | samples: averaging, read-back, time between the stages             |

Effects are no stage of a calibration: `cost_corrections` adds them, once frames are
drawn.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.renderer import RenderPlan

Rates = Mapping[str, tuple[float, ...]]  # ms for one unit of each quantity, by stage

# Quantities in millions: rates are then milliseconds of ordinary size, and the fit is conditioned.
_PER_MILLION = 1e-6
# The fit minimizes relative errors; a stage shorter than this is weighted as if it took this long.
_MIN_MS = 0.2


@dataclass(frozen=True, slots=True)
class PlanTiming:
    """Measured times of a plan."""

    plan: RenderPlan
    stage_ms: Mapping[str, float]
    """Median milliseconds of each stage."""


@dataclass(frozen=True, slots=True)
class CostModel:
    """Rates of one camera in one scene."""

    camera: OmniCamera
    rates: Mapping[str, Rates]
    """Rates by `cost_group`."""

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        """Predicted milliseconds of a frame.

        Raises:
            KeyError: No plan of this cost group was measured.
        """
        return sum(self.predict_stage_ms(plan).values())

    def predict_stage_ms(self, plan: RenderPlan) -> dict[str, float]:
        """Predicted milliseconds of each stage."""
        return {
            stage: float(np.dot(rates, cost_features(stage, plan, self.camera)))
            for stage, rates in self.rates[cost_group(plan)].items()
        }


def describe_rates(rates: Mapping[str, Rates]) -> str:
    """Rates for a log: of each stage the constant, and the rates per million of its quantities."""
    stages = [(f"{group} {stage}", r) for group in rates for stage, r in rates[group].items()]
    return "; ".join(
        f"{name} {constant:.3g} ms + {', '.join(f'{rate:.3g}' for rate in others)} ms/million"
        for name, (constant, *others) in stages
    )


def cost_group(plan: RenderPlan) -> str:
    """Group of plans that share rates: plans that run the same stages by the same code."""
    return plan.renderer.value


def cost_features(stage: str, plan: RenderPlan, camera: OmniCamera) -> tuple[float, ...]:
    """Quantities that a stage's time grows with: 1 for the constant, others in millions."""
    samples = _PER_MILLION * camera.width_px * camera.height_px * plan.samples**2
    texels = _PER_MILLION * sum(region.num_texels for region in plan.face_regions)
    match stage:
        case "trace":
            return 1.0, samples / plan.samples, samples
        case "faces":
            # The first sample of a texel is in `texels`: multisampling shades once, stores more.
            return 1.0, texels, texels * (plan.face_samples - 1)
        case "mirror":
            return 1.0, samples, texels
    return 1.0, samples


def fit_cost_model(camera: OmniCamera, timings: Iterable[PlanTiming]) -> CostModel:
    """Fit rates to measured frames, by relative least squares."""
    by_group: dict[str, list[PlanTiming]] = {}
    for timing in timings:
        by_group.setdefault(cost_group(timing.plan), []).append(timing)
    rates = {group: _fit_rates(camera, members) for group, members in by_group.items()}
    return CostModel(camera, rates)


def _fit_rates(camera: OmniCamera, timings: list[PlanTiming]) -> Rates:
    return {
        stage: fit_nonnegative_rates(
            np.array([cost_features(stage, timing.plan, camera) for timing in timings]),
            np.array([timing.stage_ms.get(stage, 0.0) for timing in timings]),
        )
        for stage in sorted({stage for timing in timings for stage in timing.stage_ms})
    }


def grows_with_quantities(rates: Rates) -> bool:
    """Whether frames of a cost group take longer with more samples or texels, all rates finite.

    Frames measured while other programs use the processors may not: those rates mean nothing.
    """
    values = [rate for stage in rates.values() for rate in stage]
    growing = [rate for stage in rates.values() for rate in stage[1:]]
    return all(map(math.isfinite, values)) and sum(growing) > 0.0


def fit_nonnegative_rates(features: Floats, ms: Floats) -> tuple[float, ...]:
    """Non-negative rates (k,) by which features (n, k) explain times (n,) best.

    Of solutions that explain equally much, the one with fewest non-zero rates is taken, and of
    those the one without a constant: a single frame cannot separate a constant from a rate.
    """
    weight = 1.0 / np.maximum(ms, _MIN_MS)
    rows, target = features * weight[:, None], ms * weight
    best, min_residual = np.zeros(features.shape[1]), float(target @ target)
    # At most three features, so seven supports: enumeration is exact and needs no NNLS solver.
    for support in _index_subsets(features.shape[1]):
        rates = np.zeros(features.shape[1])
        rates[support] = np.linalg.lstsq(rows[:, support], target, rcond=None)[0]
        residual = float(np.square(rows @ rates - target).sum())
        # A margin above rounding: equal fits must not displace the smaller support.
        if (rates >= 0.0).all() and residual < min_residual - 1e-12:
            best, min_residual = rates, residual
    return tuple(float(rate) for rate in best)


def _index_subsets(count: int) -> Iterable[list[int]]:
    """Non-empty subsets of range(count), small ones first, those with the constant (0) last."""
    sizes = range(1, count + 1)
    last_first = range(count - 1, -1, -1)
    return [list(used) for size in sizes for used in itertools.combinations(last_first, size)]
