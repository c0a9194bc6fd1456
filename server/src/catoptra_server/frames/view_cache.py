"""Prepared views by camera, created on first use: a camera without a client costs nothing.

Robots of one class share a view; a camera with another zoom or accuracy target has a view of its
own. The view rendered longest ago is closed first. Belongs to the thread that made the renderers.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import needs_radiance_only
from catoptra_server.effects.effect_plan import (
    NO_EFFECTS,
    EffectDecision,
    EffectPlan,
    apply_scene_effects,
    plan_effects,
)
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.planning.budget_monitor import BudgetMonitor, BudgetStatus
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.planning.perspective_plan import PerspectivePlan, plan_perspective_view
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import OmniView, RenderedImage, View

log = logging.getLogger(__name__)

# Clients choose fields of view: without a limit each choice would leave a view behind. A robot has
# a few cameras; a view of 320 x 240 px at 2 x 2 samples holds some 4 MB.
MAX_VIEWS = 16
# Costs are measured here where no start poses are given.
_DEFAULT_CALIBRATION_STATES = (CameraState(Pose.identity()),)

Plan = RenderPlan | PerspectivePlan


class ViewFailedError(Exception):
    """No renderer could draw the view; the text is for clients, the log has the traceback."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedView:
    """Image of one camera, with everything that a frame reports of the rendering."""

    image: RenderedImage
    plan: str
    """Plan in words."""
    error_bounds: Mapping[str, float] | None = None
    """Bounds of the image error by name; None for perspective cameras, whose error has no bound."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of an omnidirectional camera, in optical order."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """Plan of a camera and the measured cost."""

    choice: PlanChoice
    median_ms: float | None
    """Median time of the last frames; None before 30 frames."""


@dataclass(slots=True, eq=False)
class _CachedView:
    """A view and the plan that it follows."""

    plan: Plan
    view: View
    budget_monitor: BudgetMonitor
    choice: PlanChoice | None = None
    """None for a perspective camera."""
    effects: EffectPlan = NO_EFFECTS
    """Effects of the last frame."""
    budget_status: BudgetStatus = BudgetStatus.WITHIN_BUDGET
    budget_unreachable: bool = False
    """Whether planning found nothing faster although the budget is exceeded; logged once."""
    plan_text: str = field(init=False)
    bounds: dict[str, float] | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._format()

    def _format(self) -> None:
        # Once a plan: every frame of the view carries the same text and numbers.
        self.plan_text = str(self.plan)
        if self.choice is not None and self.choice.bound is not None:
            self.bounds = self.choice.bound.as_dict()

    def set_choice(self, choice: PlanChoice) -> None:
        """Replace the plan by a new choice."""
        self.plan, self.choice = choice.plan, choice
        self._format()


@dataclass(slots=True)
class ErrorBoundTable:
    """Error bounds of the prepared views by camera; any thread may read them."""

    # Without a lock: one writer, and single operations of a dict are atomic.
    _bounds: dict[CameraSpec, ErrorBound | None] = field(default_factory=dict)

    def get(self, camera: CameraSpec) -> ErrorBound | None:
        """Error bound of a camera's view; None without a view or a bound."""
        return self._bounds.get(camera)

    def put(self, camera: CameraSpec, bound: ErrorBound | None) -> None:
        """Publish the bound of a prepared view."""
        self._bounds[camera] = bound

    def remove(self, camera: CameraSpec) -> None:
        """Remove the bound of a closed view."""
        self._bounds.pop(camera, None)


class ViewCache:
    """The views of one scene; closing them frees the renderers, too."""

    def __init__(
        self,
        planner: RenderPlanner,
        summarizer: SceneSummarizer,
        *,
        max_views: int = MAX_VIEWS,
        calibration_states: Sequence[CameraState] = _DEFAULT_CALIBRATION_STATES,
        error_bounds: ErrorBoundTable | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Create an empty cache.

        Args:
            planner: Chooses plans and owns the renderers.
            summarizer: Summarizes the scene for the decisions about effects.
            max_views: Number of views above which the one rendered longest ago is closed.
            calibration_states: Camera states to measure costs from, where an accuracy target
                needs measured costs.
            error_bounds: Table to publish error bounds in.
            clock: Clock in seconds that frames are timed by.
        """
        self._planner = planner
        self._summarizer = summarizer
        self._max_views = max_views
        self._calibration_states = calibration_states
        self._error_bounds = error_bounds or ErrorBoundTable()
        self._clock = clock
        self._cached: dict[CameraSpec, _CachedView] = {}  # the last rendered at the end

    def __len__(self) -> int:
        """Number of prepared views."""
        return len(self._cached)

    def prepare(self, camera: CameraSpec) -> str:
        """Prepare the view of a camera ahead of the first frame, and return the plan in words."""
        return self._get_or_prepare(camera).plan_text

    def render(self, request: ViewRequest) -> RenderedView:
        """Render a view; the first frame of a camera includes the preparation."""
        cached = self._get_or_prepare(request.camera)
        if not isinstance(request.camera, OmniCameraSpec):
            return RenderedView(cached.view.render(request.camera_state), cached.plan_text)
        # Planned anew before a frame, not after: the frame's plan is the one that rendered it.
        if cached.budget_status is not BudgetStatus.WITHIN_BUDGET:
            self._replan(request.camera, cached)
        begin_s = self._clock()
        rendered = self._render_omni(request.camera, request.camera_state, cached)
        self._record_frame_time(request.camera, cached, 1e3 * (self._clock() - begin_s))
        return rendered

    def _render_omni(
        self, camera: OmniCameraSpec, camera_state: CameraState, cached: _CachedView
    ) -> RenderedView:
        """Render a view with the effects that the camera state calls for."""
        # Views of this kind of camera are prepared by `Renderer.prepare` only.
        view = cast(OmniView, cached.view)
        if not camera.effect_settings.settings:
            return RenderedView(view.render(camera_state), cached.plan_text, cached.bounds)
        plan = self._decide_effects(camera, camera_state)
        # Bounds move with every pose; only a change of the enabled effects is worth a log line.
        if cached.effects is NO_EFFECTS or plan.enabled_effects != cached.effects.enabled_effects:
            log.info("effects:\n%s", plan)
        cached.effects = plan
        image = view.render(apply_scene_effects(camera_state, plan), plan.image_effects)
        return RenderedView(image, cached.plan_text, cached.bounds, plan.decisions)

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Plan that the next frame of a camera will have; prepares no view."""
        cached = self._cached.get(camera)
        if cached is None or cached.choice is None:
            return ViewState(self._planner.choose_plan(camera, self._calibration_states), None)
        return ViewState(cached.choice, cached.budget_monitor.median_ms)

    def _get_or_prepare(self, camera: CameraSpec) -> _CachedView:
        # Removed and inserted again: dicts keep the order of insertion.
        cached = self._cached.pop(camera, None) or self._prepare(camera)
        self._cached[camera] = cached
        return cached

    def _prepare(self, camera: CameraSpec) -> _CachedView:
        # Closed before the new view is made: the two need not fit into memory together.
        while len(self._cached) >= self._max_views:
            oldest = next(iter(self._cached))
            self._error_bounds.remove(oldest)
            self._cached.pop(oldest).view.close()
        if isinstance(camera, OmniCameraSpec):
            choice = self._planner.choose_plan(camera, self._calibration_states)
            monitor = BudgetMonitor(camera.render_settings.accuracy_target.budget_ms)
            return _CachedView(choice.plan, self._prepare_view(camera, choice), monitor, choice)
        kind = self._planner.default_kind
        plan = plan_perspective_view(0, kind=kind, reason=self._planner.reason)
        view = self._planner.get_renderer(kind).prepare_perspective(camera, plan.samples)
        return _CachedView(plan, view, BudgetMonitor(0.0))

    def _prepare_view(self, spec: OmniCameraSpec, choice: PlanChoice) -> View:
        """Prepare a view by a choice, log the plan and publish the bound."""
        camera = spec.camera
        log.info("plan of %d x %d px: %s", camera.width_px, camera.height_px, choice)
        log.info("error bound: %s", choice.bound or "none")
        self._error_bounds.put(spec, choice.bound)
        return self._planner.get_renderer(choice.plan.renderer).prepare(camera, choice.plan)

    def _decide_effects(self, camera: OmniCameraSpec, camera_state: CameraState) -> EffectPlan:
        """Decide which effects a camera state calls for."""
        # Radiance bounds never change; a whole summary measures distances from the new pose.
        if needs_radiance_only(camera.effect_settings):
            summary = self._summarizer.summarize_radiance()
        else:
            summary = self._summarizer.summarize(camera_state, camera.camera)
        return plan_effects(camera.effect_settings, summary, camera.camera)

    def _record_frame_time(self, camera: OmniCameraSpec, cached: _CachedView, ms: float) -> None:
        """Compare the time of a frame with the budget and with the predicted cost."""
        choice, monitor = cached.choice, cached.budget_monitor
        assert choice is not None, "the plan of an omnidirectional camera is a choice"
        better = choice.more_accurate
        better_ms = self._planner.predict_frame_ms(camera, better.plan) if better else None
        status = monitor.record_frame(ms, better_plan_ms=better_ms)
        # Nothing faster was found before: planning again would not find it either.
        is_settled = status is BudgetStatus.OVER_BUDGET and cached.budget_unreachable
        cached.budget_status = BudgetStatus.WITHIN_BUDGET if is_settled else status
        median_ms = monitor.median_ms
        if median_ms is not None and choice.predicted_ms is not None:
            self._planner.update_correction(camera, choice.plan, median_ms)

    def _replan(self, camera: OmniCameraSpec, cached: _CachedView) -> None:
        """Choose a plan anew, and prepare a view if the plan differs."""
        status, cached.budget_status = cached.budget_status, BudgetStatus.WITHIN_BUDGET
        choice = self._planner.choose_plan(camera, self._calibration_states)
        is_over = status is BudgetStatus.OVER_BUDGET
        log.info(
            "%.1f ms a frame (median), budget %g ms: %s",
            cached.budget_monitor.median_ms,
            camera.render_settings.accuracy_target.budget_ms,
            "too slow" if is_over else "headroom",
        )
        cached.budget_monitor.reset(status)
        # The reason quotes predicted milliseconds, which differ each time.
        is_same = cached.plan == replace(choice.plan, reason=cached.plan.reason)
        cached.budget_unreachable = is_same and is_over
        if is_same:
            log.info("no better plan: %s", choice)
        else:
            cached.view.close()
            cached.view = self._prepare_view(camera, choice)
        cached.set_choice(choice)

    def close(self) -> None:
        """Close all views, and the renderers."""
        for cached in self._cached.values():
            cached.view.close()
        self._cached.clear()
        self._planner.close()
