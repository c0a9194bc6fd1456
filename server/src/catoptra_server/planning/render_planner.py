"""How an eye is drawn: by its numbers, or by what its dial and measured costs say.

Nothing is measured before somebody turns a dial. Then every renderer that could draw is measured
for this camera, once: the rates are kept on disk. While frames are drawn their real times correct
the prediction by a factor a renderer. Belongs to the thread that made the renderers.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.candidate_plans import generate_candidate_plans
from catoptra_server.planning.cost_cache import CostCache
from catoptra_server.planning.cost_calibration import measure_costs
from catoptra_server.planning.cost_model import CostModel, PlanTiming, Rates, fit_cost_model
from catoptra_server.planning.error_bound import ErrorBound, error_bound
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.plan_choice import PlanChoice, choose_plan, pareto_front
from catoptra_server.planning.renderer_choice import RendererChoice
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import MirrorSurface

log = logging.getLogger(__name__)

MeasureCosts = Callable[
    [Renderer, RendererKind, OmniCamera, MirrorSurface, Sequence[CameraState]], list[PlanTiming]
]
# Frames are a few times slower or faster than was measured, not more: else something else happened.
_MAX_CORRECTION = 10.0


class RenderPlanner:
    """The renderers that could draw a scene, and what their frames cost."""

    def __init__(
        self,
        choice: RendererChoice,
        cache: CostCache | None = None,
        *,
        measure: MeasureCosts = measure_costs,
    ) -> None:
        self._choice = choice
        self._renderers: dict[RendererKind, Renderer] = {choice.kind: choice.renderer}
        self._alternatives = dict(choice.alternatives)
        self._cache = cache
        self._measure = measure
        self._models: dict[tuple[OmniCamera, MirrorSurface], CostModel] = {}
        self._corrections: dict[RendererKind, float] = {}

    @property
    def default_kind(self) -> RendererKind:
        """Return the kind of renderer that draws where nothing says otherwise."""
        return self._choice.kind

    @property
    def reason(self) -> str:
        """Return why that one was taken."""
        return self._choice.reason

    def get_renderer(self, kind: RendererKind) -> Renderer:
        """Return a renderer of a kind, made now if it was not needed before."""
        if kind not in self._renderers:
            self._renderers[kind] = self._alternatives[kind]()
            log.info("%s", self._renderers[kind].describe())
        return self._renderers[kind]

    def choose_plan(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> PlanChoice:
        """Return how to draw an eye; `exposures` are what is measured if a dial asks for it."""
        plan = plan_from_settings(
            camera.render_settings, camera.camera, kind=self.default_kind, reason=self.reason
        )
        bound = _find_error_bound(camera.camera, plan)
        if not camera.render_settings.accuracy_target.is_set:
            return PlanChoice(plan, bound)
        if bound is None:
            why = f"no dial can be kept where an error has no bound; {self.reason}"
            return PlanChoice(replace(plan, reason=why), None, target_met=False)
        model = self._get_cost_model(camera, camera_states)
        kinds = [kind for kind in RendererKind if kind in self._renderers]
        steps = pareto_front(
            camera.camera,
            generate_candidate_plans(camera.render_settings.surface, camera.camera, kinds),
            _CorrectedCosts(self, model),
        )
        return choose_plan(camera.camera, steps, camera.render_settings.accuracy_target)

    def predict_frame_ms(self, camera: OmniCameraSpec, plan: RenderPlan) -> float | None:
        """Return what a plan is expected to cost now; None where its costs were never measured."""
        model = self._models.get(_cost_key(camera))
        return _CorrectedCosts(self, model).predict_frame_ms(plan) if model else None

    def cost_correction(self, kind: RendererKind) -> float:
        """Return by how much frames take longer than was measured."""
        return self._corrections.get(kind, 1.0)

    def update_correction(self, camera: OmniCameraSpec, plan: RenderPlan, median_ms: float) -> None:
        """Take note of what frames really take."""
        model = self._models.get(_cost_key(camera))
        if model is not None:
            factor = median_ms / model.predict_frame_ms(plan)
            self._corrections[plan.renderer] = min(
                max(factor, 1.0 / _MAX_CORRECTION), _MAX_CORRECTION
            )

    def _get_cost_model(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> CostModel:
        key = _cost_key(camera)
        if key not in self._models:
            self._create_alternatives()
            rates: dict[str, Rates] = {}
            for kind, renderer in self._renderers.items():
                rates.update(self._find_rates(kind, renderer, camera, camera_states))
            self._models[key] = CostModel(camera.camera, rates)
        return self._models[key]

    def _create_alternatives(self) -> None:
        """Make what else could draw; what cannot be had after all is no choice."""
        for kind in list(self._alternatives):
            try:
                self.get_renderer(kind)
            except RendererUnavailableError as error:
                del self._alternatives[kind]
                log.info("%s is no choice: %s", kind.value, error)

    def _find_rates(
        self,
        kind: RendererKind,
        renderer: Renderer,
        camera: OmniCameraSpec,
        camera_states: Sequence[CameraState],
    ) -> Mapping[str, Rates]:
        key = (
            self._cache.make_key(renderer.describe(), camera.camera, camera.render_settings.surface)
            if self._cache
            else ""
        )
        kept = self._cache.read(key) if self._cache else None
        if kept is not None:
            log.info("costs of %s are known from before", kind.value)
            return kept
        rates = fit_cost_model(
            camera.camera,
            self._measure(
                renderer, kind, camera.camera, camera.render_settings.surface, camera_states
            ),
        ).rates
        log.info("costs of %s measured: %s", kind.value, rates)
        if self._cache:
            self._cache.write(key, rates)
        return rates

    def close(self) -> None:
        """Free all renderers."""
        for renderer in self._renderers.values():
            renderer.close()


class _CorrectedCosts:
    """The costs of one camera, corrected by what frames really took."""

    def __init__(self, planner: RenderPlanner, model: CostModel) -> None:
        self._planning = planner
        self._model = model

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        return self._model.predict_frame_ms(plan) * self._planning.cost_correction(plan.renderer)


def _cost_key(camera: OmniCameraSpec) -> tuple[OmniCamera, MirrorSurface]:
    """Return what rates depend on."""
    return camera.camera, camera.render_settings.surface


def _find_error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound | None:
    try:
        return error_bound(camera, plan)
    except DomainError as error:
        log.info("the error of this plan has no bound: %s", error)
        return None
