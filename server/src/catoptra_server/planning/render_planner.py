"""Plans for the cameras of one scene.

Without an accuracy target a plan follows explicit numbers, and the renderer the rule or measured
frames (`renderer_preferences`). With a target,
all renderers are measured once for the camera, and the rates are stored on disk; times of real
frames then correct the predictions by one factor a renderer. Belongs to the thread of the
renderers.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.fault_log import log_fault
from catoptra_server.lru_dict import LruDict
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.candidate_plans import generate_candidate_plans
from catoptra_server.planning.cost_cache import CostCache
from catoptra_server.planning.cost_calibration import measure_costs
from catoptra_server.planning.cost_model import CostModel, PlanTiming, Rates, fit_cost_model
from catoptra_server.planning.error_bound import ErrorBound, error_bound
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.plan_choice import (
    PlanChoice,
    PlanOption,
    choose_plan,
    pareto_front,
)
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.planning.renderer_preferences import RendererPreferences
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import MirrorSurface

log = logging.getLogger(__name__)

MeasureCosts = Callable[
    [Renderer, RendererKind, OmniCamera, MirrorSurface, Sequence[CameraState]], list[PlanTiming]
]
# Real frames take a few times the measured time at most; a larger quotient comes from a suspended
# process or a changed clock, and is not believed.
_MAX_CORRECTION = 10.0
# Cameras by zoom and tile; a table of 130 candidates holds half a megabyte.
_MAX_CAMERAS = 16


@dataclass(frozen=True, slots=True, eq=False)
class _CandidateTable:
    """Everything of one camera's candidates that no accuracy target changes."""

    model: CostModel
    options: tuple[PlanOption, ...]
    """All candidates with their bounds, and times that are not corrected yet."""


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
        device = renderers.describe(renderers.default_kind) if renderers.rule else ""
        self.preferences = RendererPreferences(renderers.rule, cache, device)
        self._cache = cache
        self._measure = measure
        self._tables: LruDict[_CostKey, _CandidateTable] = LruDict(_MAX_CAMERAS)
        self._corrections: dict[RendererKind, float] = {}

    def choose_plan(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> PlanChoice:
        """Choose the plan of a camera; the reason names the renderer, with engine and device.

        Args:
            camera_states: States to measure costs from, for a camera with an accuracy target.
        """
        choice = self._choose_plan(camera, camera_states)
        device = self.renderers.describe(choice.plan.renderer)
        return replace(choice, plan=replace(choice.plan, reason=f"{choice.plan.reason}; {device}"))

    def _choose_plan(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
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
            return PlanChoice(replace(choice.plan, reason=reason), None, target_met=False)
        choice = choose_plan(camera.camera, pareto_front(self._correct(table.options)), target)
        note = self.renderers.replacement_note
        if note:
            plan = replace(choice.plan, reason=f"{choice.plan.reason}; {note}")
            choice = replace(choice, plan=plan)
        return choice

    def _follow_settings(self, camera: OmniCameraSpec) -> PlanChoice:
        """Plan by explicit numbers, with its bound where the error has one."""
        kind, reason = self.choose_renderer(camera)
        plan = replace(self.plan_by(camera, kind), reason=reason)
        return PlanChoice(plan, _find_error_bound(camera.camera, plan))

    def choose_renderer(self, camera: OmniCameraSpec) -> tuple[RendererKind, str]:
        """Renderer of a camera without an accuracy target, and the reason."""
        pool = self.renderers
        kind, reason = self.preferences.choose(camera, pool.default_kind, pool.reason)
        return (kind, reason) if pool.is_usable(kind) else (pool.default_kind, pool.reason)

    def plan_by(self, camera: OmniCameraSpec, kind: RendererKind) -> RenderPlan:
        """Plan by explicit numbers, for one renderer."""
        return plan_from_settings(camera.render_settings, camera.camera, kind=kind, reason="")

    def find_rival(self, camera: OmniCameraSpec, kind: RendererKind) -> RendererKind | None:
        """Usable renderer that could be clearly faster than a camera's own; None for none."""
        rival = self.preferences.find_rival(camera, kind)
        return rival if rival is not None and self.renderers.is_usable(rival) else None

    def _correct(self, options: Iterable[PlanOption]) -> Iterator[PlanOption]:
        """Yield options with times that are corrected by real frames."""
        for option in options:
            factor = self.cost_correction(option.plan.renderer)
            yield replace(option, predicted_ms=factor * option.predicted_ms)

    def predict_frame_ms(self, camera: OmniCameraSpec, plan: RenderPlan) -> float | None:
        """Predicted milliseconds of a plan's frames, corrected; None without measured costs."""
        table = self._tables.get(_cost_key(camera))
        if table is None or not table.options:
            return None
        return table.model.predict_frame_ms(plan) * self.cost_correction(plan.renderer)

    def cost_correction(self, kind: RendererKind) -> float:
        """Factor by which frames take longer than measured."""
        return self._corrections.get(kind, 1.0)

    def update_correction(self, camera: OmniCameraSpec, plan: RenderPlan, median_ms: float) -> None:
        """Update a renderer's factor by the median of real frames."""
        table = self._tables.get(_cost_key(camera))
        if table is not None and table.options:
            # Against the uncorrected prediction: a correction must not feed on itself.
            factor = median_ms / table.model.predict_frame_ms(plan)
            self._corrections[plan.renderer] = min(
                max(factor, 1.0 / _MAX_CORRECTION), _MAX_CORRECTION
            )

    def discard_tables(self) -> None:
        """Plan all cameras anew: the renderers have changed."""
        self._tables.clear()

    def _make_table(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> _CandidateTable:
        """Measure all renderers for a camera, and bound all its candidates."""
        if self._follow_settings(camera).bound is None:
            return _CandidateTable(CostModel(camera.camera, {}), ())
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
        return _CandidateTable(model, tuple(options))

    def _measure_renderers(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> tuple[CostModel, list[RendererKind]]:
        """Costs of all renderers that can be measured, and their kinds."""
        rates: dict[str, Rates] = {}
        measured = []
        # Measured before candidates are listed: a renderer that fails is no candidate.
        for kind in self.renderers.create_all():
            try:
                rates.update(self._find_rates(kind, camera, camera_states))
                measured.append(kind)
            except Exception:
                log_fault(log, "%s failed to render for a measurement and is left out", kind.value)
                self.renderers.renew(kind)
        if not measured:
            raise RendererUnavailableError("no renderer could be measured: see the server's log")
        return CostModel(camera.camera, rates), measured

    def _find_rates(
        self, kind: RendererKind, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> Mapping[str, Rates]:
        renderer, surface = self.renderers.get(kind), camera.render_settings.surface
        key = ""
        if self._cache:
            key = self._cache.make_key(renderer.describe(), camera.camera, surface)
            stored = self._cache.read(key)
            if stored is not None:
                log.info("costs of %s read from the cache", kind.value)
                return stored
        timings = self._measure(renderer, kind, camera.camera, surface, camera_states)
        rates = fit_cost_model(camera.camera, timings).rates
        log.info("costs of %s measured: %s", kind.value, rates)
        if self._cache:
            self._cache.write(key, rates)
        return rates

    def close(self) -> None:
        """Close all renderers."""
        self.renderers.close()


_CostKey = tuple[OmniCamera, MirrorSurface]


def _cost_key(camera: OmniCameraSpec) -> _CostKey:
    """Everything of a camera that rates depend on."""
    return camera.camera, camera.render_settings.surface


def _find_error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound | None:
    try:
        return error_bound(camera, plan)
    except DomainError as error:
        log.info("this plan has no error bound: %s", error)
        return None
