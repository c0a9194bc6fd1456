"""Prepared views of eyes, on demand: a camera that nobody watches is never prepared.

Robots of one class share a view, and a camera that zooms, or is asked for another accuracy, asks
for another one. What was not drawn for longest is closed first. Where a time budget is broken, or
leaves room for long, the plan is chosen again. Belongs to the thread that made the renderer.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import needs_radiance_only
from catoptra_server.effects.effect_plan import NO_EFFECTS, EffectPlan, plan_effects
from catoptra_server.frames.frame_request import CameraSpec, OmniCameraSpec, ViewRequest
from catoptra_server.planning.budget_monitor import BudgetMonitor, BudgetStatus
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.planning.perspective_plan import PerspectivePlan, plan_perspective_view
from catoptra_server.planning.planner import PlanChoice
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import OmniView, RenderedImage, View
from catoptra_server.render.scene_effects import apply_scene_effects

log = logging.getLogger(__name__)

# Clients choose fields of view: without a limit each would leave a view behind. A robot has a few
# cameras; a view of 320 x 240 px at 2 x 2 samples holds some 4 MB.
MAX_VIEWS = 16
# What is measured where nobody says what is seen.
_DEFAULT_CALIBRATION_STATES = (CameraState(Pose.identity()),)

Plan = RenderPlan | PerspectivePlan


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """How an eye is drawn, and the median milliseconds of its last frames, None before 30."""

    choice: PlanChoice
    median_ms: float | None


@dataclass(slots=True, eq=False)
class _CachedView:
    """A view and the plan that it follows. choice, effects: of an omnidirectional camera's last
    frame.

    verdict: of its last frames. budget_unreachable: nothing is faster, and that was said.
    """

    plan: Plan
    view: View
    budget_monitor: BudgetMonitor
    choice: PlanChoice | None = None
    effects: EffectPlan = NO_EFFECTS
    budget_status: BudgetStatus = BudgetStatus.WITHIN_BUDGET
    budget_unreachable: bool = False


@dataclass(slots=True)
class ErrorBoundTable:
    """The bounds of what is prepared, by eye; any thread may read them."""

    _bounds: dict[CameraSpec, ErrorBound | None] = field(default_factory=dict)

    def get(self, camera: CameraSpec) -> ErrorBound | None:
        """Return the bound by which an eye is drawn; None where it is not, or has none."""
        return self._bounds.get(camera)

    def put(self, camera: CameraSpec, bound: ErrorBound | None) -> None:
        """Publish a bound."""
        self._bounds[camera] = bound

    def remove(self, camera: CameraSpec) -> None:
        """Take a bound back."""
        self._bounds.pop(camera, None)


class ViewCache:
    """The views of one scene; closing them frees the renderers, too.

    places: exposures to measure frames from where a dial asks what they cost.
    """

    def __init__(
        self,
        planner: RenderPlanner,
        *,
        max_views: int = MAX_VIEWS,
        calibration_states: Sequence[CameraState] = _DEFAULT_CALIBRATION_STATES,
        error_bounds: ErrorBoundTable | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._planner = planner
        self._max_views = max_views
        self._calibration_states = calibration_states
        self._error_bounds = error_bounds or ErrorBoundTable()
        self._clock = clock
        self._cached: dict[CameraSpec, _CachedView] = {}  # the last drawn at the end

    def __len__(self) -> int:
        """Return how many views are prepared."""
        return len(self._cached)

    def render(self, request: ViewRequest) -> RenderedImage:
        """Return the picture of a take; its eye is prepared when it is drawn for the first time."""
        prepared = self._get_or_prepare(request.camera)
        if (
            isinstance(request.camera, OmniCameraSpec)
            and prepared.budget_status is not BudgetStatus.WITHIN_BUDGET
        ):
            self._replan(request.camera, prepared)
        if not isinstance(request.camera, OmniCameraSpec):
            return prepared.view.render(request.camera_state)
        begin_s = self._clock()
        picture = self._render_omni(request.camera, request.camera_state, prepared)
        self._record_frame_time(request.camera, prepared, 1e3 * (self._clock() - begin_s))
        return picture

    def _render_omni(
        self, camera: OmniCameraSpec, camera_state: CameraState, cached: _CachedView
    ) -> RenderedImage:
        """Return the picture with those effects that the exposure calls for."""
        view = cast(OmniView, cached.view)
        if not camera.effect_settings.settings:
            return view.render(camera_state)
        plan = self._decide_effects(camera, camera_state)
        if cached.effects is NO_EFFECTS or plan.enabled_effects != cached.effects.enabled_effects:
            log.info("effects:\n%s", plan)
        cached.effects = plan
        picture = view.render(apply_scene_effects(camera_state, plan), plan.image_effects)
        return replace(picture, effects=plan.decisions)

    def plan(self, camera: CameraSpec) -> Plan:
        """Return how an eye is drawn."""
        return self._get_or_prepare(camera).plan

    def error_bound(self, camera: CameraSpec) -> ErrorBound | None:
        """Return how far off outlines may be; None of what has no bound: ordinary cameras."""
        choice = self._get_or_prepare(camera).choice
        return choice.bound if choice else None

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Return how an eye is or would be drawn; it is not prepared for that."""
        prepared = self._cached.get(camera)
        if prepared is None or prepared.choice is None:
            return ViewState(self._planner.choose_plan(camera, self._calibration_states), None)
        return ViewState(prepared.choice, prepared.budget_monitor.median_ms)

    def _get_or_prepare(self, camera: CameraSpec) -> _CachedView:
        prepared = self._cached.pop(camera, None) or self._prepare(camera)
        self._cached[camera] = prepared
        return prepared

    def _prepare(self, camera: CameraSpec) -> _CachedView:
        while len(self._cached) >= self._max_views:
            oldest = next(iter(self._cached))
            self._error_bounds.remove(oldest)
            self._cached.pop(oldest).view.close()
        if isinstance(camera, OmniCameraSpec):
            choice = self._planner.choose_plan(camera, self._calibration_states)
            watch = BudgetMonitor(camera.render_settings.accuracy_target.budget_ms)
            return _CachedView(choice.plan, self._prepare_view(camera, choice), watch, choice)
        kind = self._planner.default_kind
        flat = plan_perspective_view(0, kind=kind, reason=self._planner.reason)
        view = self._planner.get_renderer(kind).prepare_perspective(camera, flat.samples)
        return _CachedView(flat, view, BudgetMonitor(0.0))

    def _prepare_view(self, spec: OmniCameraSpec, choice: PlanChoice) -> View:
        """Return a view by a choice, and say so."""
        camera = spec.camera
        log.info("plan of %d x %d px: %s", camera.width_px, camera.height_px, choice)
        log.info("its outlines: %s", choice.bound or "no bound is known")
        self._error_bounds.put(spec, choice.bound)
        return self._planner.get_renderer(choice.plan.renderer).prepare(camera, choice.plan)

    def _decide_effects(self, camera: OmniCameraSpec, camera_state: CameraState) -> EffectPlan:
        """Return which effects an exposure calls for."""
        renderer = self._planner.get_renderer(self._planner.default_kind)
        if needs_radiance_only(camera.effect_settings):
            return plan_effects(
                camera.effect_settings, renderer.summarize_radiance(camera_state), camera.camera
            )
        return plan_effects(
            camera.effect_settings,
            renderer.summarize_scene(camera_state, camera.camera),
            camera.camera,
        )

    def _record_frame_time(self, camera: OmniCameraSpec, cached: _CachedView, ms: float) -> None:
        """Take note of a frame's time, and of what it says of the plan."""
        choice, watch = cached.choice, cached.budget_monitor
        assert choice is not None, "an omnidirectional eye's plan was chosen"
        better = choice.more_accurate
        better_ms = self._planner.predict_frame_ms(camera, better.plan) if better else None
        verdict = watch.record_frame(ms, better_plan_ms=better_ms)
        is_known = verdict is BudgetStatus.OVER_BUDGET and cached.budget_unreachable
        cached.budget_status = BudgetStatus.WITHIN_BUDGET if is_known else verdict
        median_ms = watch.median_ms
        if median_ms is not None and choice.predicted_ms is not None:
            self._planner.update_correction(camera, choice.plan, median_ms)

    def _replan(self, camera: OmniCameraSpec, cached: _CachedView) -> None:
        """Follow another plan, if there is one that keeps the budget better than this one."""
        verdict, cached.budget_status = cached.budget_status, BudgetStatus.WITHIN_BUDGET
        choice = self._planner.choose_plan(camera, self._calibration_states)
        median_ms, budget_ms = (
            cached.budget_monitor.median_ms,
            camera.render_settings.accuracy_target.budget_ms,
        )
        log.info(
            "%.1f ms a frame (median), %g ms asked: %s",
            *(
                median_ms,
                budget_ms,
                "too slow" if verdict is BudgetStatus.OVER_BUDGET else "room for more",
            ),
        )
        cached.budget_monitor.reset(verdict)
        is_same = cached.plan == replace(choice.plan, reason=cached.plan.reason)
        cached.budget_unreachable = is_same and verdict is BudgetStatus.OVER_BUDGET
        if is_same:
            log.info("there is nothing better to do: %s", choice)
            cached.plan, cached.choice = choice.plan, choice
            return
        cached.view.close()
        cached.view = self._prepare_view(camera, choice)
        cached.plan, cached.choice = choice.plan, choice

    def close(self) -> None:
        """Free all views, and the renderers."""
        for prepared in self._cached.values():
            prepared.view.close()
        self._cached.clear()
        self._planner.close()
