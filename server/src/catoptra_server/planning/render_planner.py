"""Plans for the cameras of one scene, and the renderers that follow them.

Without an accuracy target a plan follows explicit numbers and no cost is measured. With a target,
all renderers are measured once for the camera, and the rates are stored on disk; times of real
frames then correct the predictions by one factor a renderer. Belongs to the thread that made the
renderers.
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
# Real frames take a few times the measured time at most; a larger quotient comes from a suspended
# process or a changed clock, and is not believed.
_MAX_CORRECTION = 10.0


class RenderPlanner:
    """Renderers of a scene with the measured costs of their frames."""

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
        """Kind of the renderer that was chosen for the server."""
        return self._choice.kind

    @property
    def reason(self) -> str:
        """Reason of that choice."""
        return self._choice.reason

    def get_renderer(self, kind: RendererKind) -> Renderer:
        """Renderer of a kind, created at the first call."""
        if kind not in self._renderers:
            self._renderers[kind] = self._alternatives[kind]()
            log.info("%s", self._renderers[kind].describe())
        return self._renderers[kind]

    def choose_plan(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> PlanChoice:
        """Choose the plan of a camera.

        Args:
            camera_states: States to measure costs from, for a camera with an accuracy target.
        """
        plan = plan_from_settings(
            camera.render_settings, camera.camera, kind=self.default_kind, reason=self.reason
        )
        bound = _find_error_bound(camera.camera, plan)
        if not camera.render_settings.accuracy_target.is_set:
            return PlanChoice(plan, bound)
        if bound is None:
            reason = f"no target can be met: this mirror's error has no bound; {self.reason}"
            return PlanChoice(replace(plan, reason=reason), None, target_met=False)
        # Measured before candidates are listed: an alternative that fails to start leaves the list
        # of kinds.
        model = self._get_cost_model(camera, camera_states)
        kinds = [kind for kind in RendererKind if kind in self._renderers]
        options = pareto_front(
            camera.camera,
            generate_candidate_plans(camera.render_settings.surface, camera.camera, kinds),
            _CorrectedCosts(self, model),
        )
        return choose_plan(camera.camera, options, camera.render_settings.accuracy_target)

    def predict_frame_ms(self, camera: OmniCameraSpec, plan: RenderPlan) -> float | None:
        """Predicted milliseconds of a plan's frames, corrected; None without measured costs."""
        model = self._models.get(_cost_key(camera))
        return _CorrectedCosts(self, model).predict_frame_ms(plan) if model else None

    def cost_correction(self, kind: RendererKind) -> float:
        """Factor by which frames take longer than measured."""
        return self._corrections.get(kind, 1.0)

    def update_correction(self, camera: OmniCameraSpec, plan: RenderPlan, median_ms: float) -> None:
        """Update a renderer's factor by the median of real frames."""
        model = self._models.get(_cost_key(camera))
        if model is not None:
            # Against the uncorrected prediction: a correction must not feed on itself.
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
        """Create all renderers; one that cannot be created is no candidate."""
        for kind in list(self._alternatives):
            try:
                self.get_renderer(kind)
            except RendererUnavailableError as error:
                del self._alternatives[kind]
                log.info("%s is not available: %s", kind.value, error)

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
        stored = self._cache.read(key) if self._cache else None
        if stored is not None:
            log.info("costs of %s read from the cache", kind.value)
            return stored
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
        """Close all renderers."""
        for renderer in self._renderers.values():
            renderer.close()


class _CorrectedCosts:
    """Costs of one camera, corrected by real frames."""

    def __init__(self, planner: RenderPlanner, model: CostModel) -> None:
        self._planner = planner
        self._model = model

    def predict_frame_ms(self, plan: RenderPlan) -> float:
        """Predicted milliseconds of a frame."""
        return self._model.predict_frame_ms(plan) * self._planner.cost_correction(plan.renderer)


def _cost_key(camera: OmniCameraSpec) -> tuple[OmniCamera, MirrorSurface]:
    """Everything of a camera that rates depend on."""
    return camera.camera, camera.render_settings.surface


def _find_error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound | None:
    try:
        return error_bound(camera, plan)
    except DomainError as error:
        log.info("this plan has no error bound: %s", error)
        return None
