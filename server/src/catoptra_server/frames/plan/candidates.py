"""Candidate plans of a camera with their bounds and predicted times, from a few timed plans.

Candidates vary every number of a plan in useful steps: some 130 for a camera with both renderers.
Mesh and exact mirror are never exchanged for each other: a mesh costs more and shows less, but a
robot's file that has one describes the mirror. Seven plans of this scene and camera are rendered
for a few frames each, 1 to 3 s in all, most for preparation; rates fitted to their medians
(`costs.py`) predict the others. Constants of another machine are never used.
"""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from catoptra_protocol.errors import RendererUnavailableError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import (
    CostCache,
    CostModel,
    PlanTiming,
    Rates,
    describe_rates,
    fit_cost_model,
    grows_with_quantities,
)
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.plans import (
    PlanOption,
    needs_exact_rays,
    plan_from_settings,
    plan_view_size,
)
from catoptra_server.frames.renderers import RendererPool
from catoptra_server.render.render_settings import MirrorSurface, RenderSettings
from catoptra_server.render.renderer import Renderer, RenderPlan, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES
from catoptra_server.world.camera_state import CameraState

log = logging.getLogger(__name__)

# Of a renderer whose costs make no sense, beside programs that use the processors.
_MAX_MEASUREMENTS = 3
MeasureCosts = Callable[
    [Renderer, RendererKind, OmniCamera, MirrorSurface, Sequence[CameraState]], list[PlanTiming]
]


@dataclass(frozen=True, slots=True, eq=False)
class CandidateTable:
    """Everything of one camera's candidates that no accuracy target changes."""

    model: CostModel
    options: tuple[PlanOption, ...]
    """All candidates with their bounds, and times that are not corrected yet."""


class RendererCalibration:
    """Measured costs of the renderers of one scene, kept on disk."""

    def __init__(
        self, renderers: RendererPool, cache: CostCache | None, measure: MeasureCosts
    ) -> None:
        """Create a calibration that has measured nothing.

        Args:
            renderers: Renderers to measure.
            cache: Costs that earlier servers measured; None measures anew.
            measure: Measures the calibration plans of a renderer.
        """
        self._renderers = renderers
        self._cache = cache
        self._measure = measure

    def make_table(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> CandidateTable:
        """Measure the renderers of a camera, and bound all candidates."""
        model, kinds = self._measure_renderers(camera, camera_states)
        plans = generate_candidate_plans(camera.render_settings.surface, camera.camera, kinds)
        options = (
            PlanOption(
                plan,
                error_bound(camera.camera, plan).outline_error_px,
                model.predict_frame_ms(plan),
            )
            for plan in plans
        )
        return CandidateTable(model, tuple(options))

    def _measure_renderers(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> tuple[CostModel, list[RendererKind]]:
        """Costs of the renderers that can be measured, and their kinds."""
        rates: dict[str, Rates] = {}
        measured = []
        # Measured before candidates are listed: a renderer that fails is no candidate.
        for kind in self._renderers.create_candidates(camera.render_settings.renderer):
            try:
                rates.update(self._find_rates(kind, camera, camera_states))
                measured.append(kind)
            except Exception:
                log_fault(log, "%s failed to render for a measurement and is left out", kind.value)
                self._renderers.renew(kind)
        if not measured:
            raise RendererUnavailableError("no renderer could be measured: see the server's log")
        return CostModel(camera.camera, rates), measured

    def _find_rates(
        self, kind: RendererKind, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> Mapping[str, Rates]:
        renderer, surface = self._renderers.get(kind), camera.render_settings.surface
        key = ""
        if self._cache:
            key = self._cache.make_key(renderer.describe(), camera.camera, surface)
            stored = self._cache.read(key)
            # Files of earlier releases may hold costs that were measured beside other programs.
            if stored is not None and all(map(grows_with_quantities, stored.values())):
                log.info("costs of %s read from the cache", kind.value)
                return stored
        for _ in range(_MAX_MEASUREMENTS):
            timings = self._measure(renderer, kind, camera.camera, surface, camera_states)
            rates = fit_cost_model(camera.camera, timings).rates
            log.info("costs of %s measured: %s", kind.value, describe_rates(rates))
            if all(map(grows_with_quantities, rates.values())):
                if self._cache:
                    self._cache.write(key, rates)
                return rates
        log.warning(
            "costs of %s do not grow with samples: other programs used the processors meanwhile; "
            "they are not stored, and are measured again after the next start",
            kind.value,
        )
        return rates


SAMPLE_COUNTS = tuple(range(1, 9))
# Below half a texel a pixel a face blurs the image; above four the atlas costs time for no detail.
TEXELS_PER_PX = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
FACE_SAMPLE_COUNTS = (1, 4)
# (samples, texels a pixel, samples a texel): each rate of the raster stages in `cost_model` has a
# plan that differs from the first in that quantity.
_RASTER_CALIBRATION = ((1, 0.5, 1), (4, 1.0, 1), (1, 1.5, 1), (1, 1.0, 4))
# Samples along a pixel's side: the plans used most, and one with many samples for the third rate.
_TRACE_CALIBRATION = (1, 2, 5)


def generate_candidate_plans(
    surface: MirrorSurface, camera: OmniCamera, kinds: Iterable[RendererKind]
) -> Iterator[RenderPlan]:
    """Yield all plans by which some renderers can render a camera."""
    for kind in kinds:
        if needs_exact_rays(camera, kind):
            continue
        for settings in _candidate_settings(surface, kind):
            # Faces and mesh limits depend on all numbers but the samples: computed once for eight.
            plan = plan_from_settings(settings, camera, kind=kind, reason="candidate")
            yield from _fitting_plans(
                camera, [replace(plan, samples=samples) for samples in SAMPLE_COUNTS]
            )


def generate_calibration_plans(
    kind: RendererKind, camera: OmniCamera, surface: MirrorSurface
) -> Iterator[RenderPlan]:
    """Yield the plans whose times determine the rates of all candidates of one renderer.

    One that would take too much memory has fewer samples, as candidates have.
    """
    for settings in _calibration_settings(kind, surface):
        plan = plan_from_settings(settings, camera, kind=kind, reason="calibration")
        fewer = (replace(plan, samples=samples) for samples in range(plan.samples, 0, -1))
        yield from itertools.islice(_fitting_plans(camera, fewer), 1)


_Clock = Callable[[], float]
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
    clock: _Clock = time.perf_counter,
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


def _fitting_plans(camera: OmniCamera, plans: Iterable[RenderPlan]) -> Iterator[RenderPlan]:
    """Yield the plans within the default memory limit, and those with the fewest samples.

    A client's accuracy target must not take more memory than a robot's file may request.
    """
    for plan in plans:
        is_smallest = plan.samples == 1 and plan.face_samples == 1
        if is_smallest or plan_view_size(camera, plan).num_bytes <= DEFAULT_LIMIT_BYTES:
            yield plan


def _candidate_settings(surface: MirrorSurface, kind: RendererKind) -> Iterator[RenderSettings]:
    """Yield the candidates' settings, all numbers but the samples."""
    base = RenderSettings(surface)
    if kind is RendererKind.TRACE:
        yield base
        return
    for texels_per_px in TEXELS_PER_PX:
        for samples in FACE_SAMPLE_COUNTS:
            yield replace(base, texels_per_px=texels_per_px, face_samples=samples)


def _calibration_settings(kind: RendererKind, surface: MirrorSurface) -> Iterator[RenderSettings]:
    base = RenderSettings(surface)
    if kind is RendererKind.TRACE:
        for samples in _TRACE_CALIBRATION:
            yield replace(base, samples=samples)
        return
    for samples, texels_per_px, face_samples in _RASTER_CALIBRATION:
        yield replace(base, samples=samples, texels_per_px=texels_per_px, face_samples=face_samples)


def _measure_stages(
    view: View, camera_states: Sequence[CameraState], clock: _Clock
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
    from statistics import median

    return {stage: median(frame[stage] for frame in frames) for stage in frames[0]}
