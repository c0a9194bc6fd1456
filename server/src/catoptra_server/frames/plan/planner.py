"""Plans for the cameras of one scene, with the measured costs of their frames.

Without an accuracy target a plan follows explicit numbers, by the renderer that the server chose.
With a target its renderers are measured once for the camera, and the rates are stored on disk;
times of drawn frames then correct the predictions by one factor a renderer and a time of the
camera's effects. When to choose anew is decided by `frame_plan.py`. Belongs to the thread of the
renderers.

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
from catoptra_server.frames.plan.camera import OmniCameraSpec, describe_viewpoint
from catoptra_server.frames.plan.costs import (
    CostCache,
    CostCorrections,
    CostModel,
    PlanTiming,
    Rates,
    added_ms,
    describe_rates,
    fit_cost_model,
    grows_with_quantities,
)
from catoptra_server.frames.plan.error_bound import error_bound
from catoptra_server.frames.plan.plans import (
    PlanChoice,
    PlanOption,
    SceneDisplacements,
    choose_by_settings,
    choose_plan,
    needs_exact_rays,
    pareto_front,
    plan_from_settings,
    plan_view_size,
)
from catoptra_server.frames.renderers import RendererPool
from catoptra_server.render.renderer import (
    MirrorSurface,
    Renderer,
    RenderPlan,
    RenderSettings,
    View,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, LruDict
from catoptra_server.world.objects import CameraState

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


# Cameras by zoom and tile; a table of 130 candidates holds half a megabyte.
_MAX_CAMERAS = 16


class RenderPlanner:
    """Plans for the cameras of a scene, with the measured costs of their frames."""

    def __init__(
        self,
        renderers: RendererPool,
        cache: CostCache | None = None,
        *,
        measure: MeasureCosts = measure_costs,
    ) -> None:
        """Create a planner that has measured nothing.

        Args:
            renderers: Renderers that plans may choose.
            cache: Costs that earlier servers measured; None measures anew.
            measure: Measures the calibration plans of a renderer.
        """
        self.renderers = renderers
        self._calibration = RendererCalibration(renderers, cache, measure)
        self._tables: LruDict[_CostKey, CandidateTable] = LruDict(_MAX_CAMERAS)
        self._corrections = CostCorrections()

    def choose_plan(
        self,
        camera: OmniCameraSpec,
        camera_states: Sequence[CameraState],
        scene: SceneDisplacements | None = None,
    ) -> PlanChoice:
        """Choose the plan of a camera; the reason names the renderer, with engine and device.

        Args:
            camera_states: States to measure costs from, for a camera with an accuracy target.
            scene: The scene's part of the bounds there; the choice's bound is without it.
        """
        choice = self._choose_plan(camera, camera_states, scene)
        device = self.renderers.describe(choice.plan.renderer)
        notes = [choice.plan.reason, describe_viewpoint(camera), device]
        reason = "; ".join(note for note in notes if note)
        return replace(choice, plan=replace(choice.plan, reason=reason))

    def _choose_plan(
        self,
        camera: OmniCameraSpec,
        camera_states: Sequence[CameraState],
        scene: SceneDisplacements | None,
    ) -> PlanChoice:
        target = camera.render_settings.accuracy_target
        if not target.is_set:
            return self._follow_settings(camera)
        # Bounds and costs of the candidates are the same for all targets: the first plan of a
        # camera takes 0.1 s and more, every other one a millisecond.
        table = self._tables.get_or_make(
            _cost_key(camera), lambda: self._make_table(camera, camera_states)
        )
        if not table.options:
            choice = self._follow_settings(camera)
            reason = f"no target can be met: this mirror's error has no bound; {choice.plan.reason}"
            plan = replace(choice.plan, reason=reason)
            return PlanChoice(plan, None, target=target, fits_budget=False)
        correct = self._corrections.correct
        placed = table.options
        if scene:
            placed = tuple(one.place(camera.camera, scene) for one in placed)
        # Corrected by drawn frames.
        corrected = (
            replace(one, predicted_ms=correct(camera, one.plan.renderer, one.predicted_ms))
            for one in placed
        )
        choice = choose_plan(camera.camera, pareto_front(corrected), target)
        note = self.renderers.note
        if note:
            plan = replace(choice.plan, reason=f"{choice.plan.reason}; {note}")
            choice = replace(choice, plan=plan)
        return choice

    def _follow_settings(self, camera: OmniCameraSpec) -> PlanChoice:
        """Plan by explicit numbers, with a bound where the error has one."""
        pool, requested = self.renderers, camera.render_settings.renderer
        kind, reason = pool.default_kind, pool.reason
        if requested and pool.is_usable(RendererKind(requested)):
            kind, reason = RendererKind(requested), "as requested"
        others = [one for one in RendererKind if pool.is_usable(one)]
        return choose_by_settings(camera, kind, reason, usable=others)

    def predict_frame_ms(self, camera: OmniCameraSpec, plan: RenderPlan) -> float | None:
        """Predicted milliseconds of a plan's frames, corrected; None without measured costs."""
        model = self._find_model(camera)
        if model is None:
            return None
        return self._corrections.correct(camera, plan.renderer, model.predict_frame_ms(plan))

    def update_times(self, camera: OmniCameraSpec, choice: PlanChoice) -> PlanChoice:
        """Choice with times of plan and neighbours as predicted now."""
        if choice.predicted_ms is None:
            return choice
        more_accurate, faster = (
            option and self._update_option(camera, option)
            for option in (choice.more_accurate, choice.faster)
        )
        ms = self.predict_frame_ms(camera, choice.plan)
        return replace(choice, predicted_ms=ms, more_accurate=more_accurate, faster=faster)

    def _update_option(self, camera: OmniCameraSpec, option: PlanOption) -> PlanOption:
        ms = self.predict_frame_ms(camera, option.plan)
        return option if ms is None else replace(option, predicted_ms=ms)

    def added_ms(
        self, camera: OmniCameraSpec, plan: RenderPlan, stage_ms: Mapping[str, float]
    ) -> float:
        """Milliseconds of a frame's stages that the cost model has not, such as effects."""
        model = self._find_model(camera)
        return 0.0 if model is None else added_ms(stage_ms, model.predict_stage_ms(plan))

    def update_correction(
        self, camera: OmniCameraSpec, plan: RenderPlan, median_ms: float, added_ms: float = 0.0
    ) -> None:
        """Update the corrections by medians of drawn frames.

        Args:
            median_ms: Median time of the frames.
            added_ms: Median time of their stages that the cost model has not.
        """
        model = self._find_model(camera)
        if model is not None:
            self._corrections.update(
                camera,
                plan.renderer,
                model.predict_frame_ms(plan),
                median_ms=median_ms,
                added_ms=added_ms,
            )

    def _find_model(self, camera: OmniCameraSpec) -> CostModel | None:
        """Cost model of a camera; None without measured costs."""
        table = self._tables.get(_cost_key(camera))
        return table.model if table is not None and table.options else None

    def discard_tables(self) -> None:
        """Plan all cameras anew: the renderers have changed."""
        self._tables.clear()
        self._corrections.clear()

    def _make_table(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> CandidateTable:
        """Measure the renderers of a camera, and bound all candidates."""
        if self._follow_settings(camera).bound is None:
            return CandidateTable(CostModel(camera.camera, {}), ())
        return self._calibration.make_table(camera, camera_states)

    def close(self) -> None:
        """Close all renderers."""
        self.renderers.close()


_CostKey = tuple[OmniCamera, MirrorSurface, str]


def _cost_key(camera: OmniCameraSpec) -> _CostKey:
    """Everything of a camera that rates and candidates depend on."""
    settings = camera.render_settings
    return camera.camera, settings.surface, settings.renderer
