"""Rendered views of cameras: planned and prepared on first use, and rendered again after a fault.

A camera without a client costs nothing. Belongs to the thread that made the renderers.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import cast

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import ImageEffect, needs_radiance_only
from catoptra_server.effects.effect_plan import (
    EffectDecision,
    EffectPlan,
    apply_scene_effects,
    describe_changes,
    format_decisions,
    plan_effects,
)
from catoptra_server.frames.camera_plans import (
    DEFAULT_CALIBRATION_STATES,
    CameraPlans,
    ErrorBoundTable,
    ViewState,
)
from catoptra_server.frames.frame_labeller import FrameLabeller
from catoptra_server.frames.frame_labels import FrameLabels
from catoptra_server.frames.frame_request import Channel, ViewRequest
from catoptra_server.frames.planned_camera import PlannedCamera
from catoptra_server.frames.renderer_recovery import RendererRecovery
from catoptra_server.frames.view_store import MAX_VIEW_BYTES, MAX_VIEWS, ViewStore
from catoptra_server.ground_truth.label_rays import DrawnExposure
from catoptra_server.lru_dict import LruDict
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.planning.exposure_budget import explain_limit, limit_time_samples
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.rounding_error import coordinate_errors
from catoptra_server.planning.viewpoint_choice import (
    choose_viewpoint,
    leaves_choice,
    shows_ego_body,
)
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import NO_THRESHOLDS, RenderedImage, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.label_tables import LabelRequest
from catoptra_server.render.trace.trace_engine import LabellingView, PixelLabels

log = logging.getLogger(__name__)

# As many as plans are kept of.
_MAX_CHOICES = 256


@dataclass(frozen=True, slots=True, eq=False)
class RenderedView:
    """Image of one camera, with everything that a frame reports of the rendering."""

    image: RenderedImage
    plan: str
    """Plan in words."""
    error_bounds: Mapping[str, float] | None = None
    """Bounds of the image error by name; None for perspective cameras, whose error has no bound."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of the camera, in optical order."""
    choice: PlanChoice | None = None
    """Choice of the plan; None for a perspective camera."""
    drawn: DrawnExposure | None = None
    """The exposure as the image shows it, for labels."""
    labels: PixelLabels | None = None
    """Labels that were found while the image was drawn."""


class ViewCache:
    """The views of one scene; closing them frees the renderers, too."""

    def __init__(
        self,
        planner: RenderPlanner,
        summarizer: SceneSummarizer,
        *,
        max_bytes: int = MAX_VIEW_BYTES,
        max_views: int = MAX_VIEWS,
        calibration_states: Sequence[CameraState] = DEFAULT_CALIBRATION_STATES,
        error_bounds: ErrorBoundTable | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Create an empty cache.

        Args:
            planner: Chooses plans and owns the renderers.
            summarizer: Summarizes the scene for the decisions about effects.
            max_bytes: Memory of prepared views above which the one rendered longest ago is closed.
            max_views: Number of views above which the one rendered longest ago is closed.
            calibration_states: Camera states to measure costs from, where an accuracy target
                needs measured costs.
            error_bounds: Table to publish error bounds in.
            clock: Clock in seconds that frames are timed by.
        """
        self._planner = planner
        self._summarizer = summarizer
        self._clock = clock
        self._last_drawn: LruDict[OmniCameraSpec, OmniCameraSpec] = LruDict(_MAX_CHOICES)
        """Of mirrors without a viewpoint, the camera that the last frame drew."""
        self._views = ViewStore(planner.renderers, max_bytes=max_bytes, max_views=max_views)
        self._labeller = FrameLabeller(planner.renderers, summarizer)
        self._plans = CameraPlans(
            planner, calibration_states=calibration_states, error_bounds=error_bounds
        )
        self._recovery = RendererRecovery(planner, self._plans, close_views=self._close_views_of)

    def _close_views_of(self, kind: RendererKind) -> None:
        """Close all views of one renderer, and the rays of labels, which may be of the same."""
        self._labeller.close()
        self._views.close_views_of(kind)

    def __len__(self) -> int:
        """Number of prepared views."""
        return len(self._views)

    def prepare(self, camera: CameraSpec) -> str:
        """Prepare the view of a camera ahead of the first frame, and return the plan in words.

        Raises:
            ViewFailedError: No renderer can prepare the view.
        """

        def prepare_view(planned: PlannedCamera) -> str:
            self._views.get(planned)
            self._views.trim()
            return planned.plan_text

        return self._recovery.work(camera, prepare_view)

    def render(self, request: ViewRequest) -> RenderedView:
        """Render a view; the first frame of a camera includes the preparation.

        Raises:
            ViewFailedError: No renderer can draw the view.
        """
        camera = self._choose_viewpoint(request)
        if camera is not request.camera:
            # Its rays are others than those of the camera that is labelled.
            request = replace(request, request_labels=None)
        rendered = self._recovery.work(camera, partial(self._render_by_plan, request))
        if camera is not request.camera:
            self._plans.publish_bound(request.camera, rendered.choice)
            # Labels are of the mirror's own rays, however far a frame's scene is.
            assert rendered.drawn is not None
            drawn = replace(rendered.drawn, camera=request.camera.camera)
            return replace(rendered, drawn=drawn)
        return rendered

    def label(
        self, rendered: RenderedView, channels: tuple[str, ...], channel: Channel, time_s: float
    ) -> FrameLabels:
        """Label the pixels of a rendered view.

        Args:
            rendered: The view.
            channels: Names of the channels that are wanted.
            channel: Channel of the frame, to whose last frame the flow leads.
            time_s: Simulation time of the exposure.

        Raises:
            ViewFailedError: The labels take too much memory, or no ray can be traced here.
        """
        assert rendered.drawn is not None, "a view with labels was drawn here"
        return self._labeller.label(rendered.drawn, channels, channel, time_s, rendered.labels)

    def request_labels(
        self, channels: tuple[str, ...], drawn: DrawnExposure
    ) -> LabelRequest | None:
        """Labels of channels that can be found while a view is drawn; see `ViewRequest`."""
        return self._labeller.request(drawn, channels)

    def _choose_viewpoint(self, request: ViewRequest) -> CameraSpec:
        """Camera of a frame: with one viewpoint where the scene is far enough."""
        camera = request.camera
        if not isinstance(camera, OmniCameraSpec) or not leaves_choice(camera):
            return camera
        nearest_m = self._summarizer.min_distance_m(
            request.camera_state, has_ego_body=shows_ego_body(camera)
        )
        chosen = choose_viewpoint(camera, nearest_m)
        self._last_drawn.put(camera, chosen)
        return chosen

    def _render_by_plan(self, request: ViewRequest, planned: PlannedCamera) -> RenderedView:
        """Render a view by a plan."""
        if not isinstance(planned.spec, OmniCameraSpec):
            rendered = self._render_with_effects(planned, request)
            self._views.trim()
            return rendered
        # Planned anew before a frame, not after: the frame's plan is the one that rendered it.
        self._plans.replan_if_due(planned)
        # Prepared ahead of the clock: the first frame's time is not that of the later ones.
        self._views.get(planned)
        begin_s = self._clock()
        rendered = self._render_with_effects(planned, request)
        frame_ms = 1e3 * (self._clock() - begin_s)
        self._plans.record_frame(planned, frame_ms, rendered.image.stage_ms)
        self._views.trim()
        return rendered

    def _render_with_effects(self, planned: PlannedCamera, request: ViewRequest) -> RenderedView:
        """Render a view with the effects that the camera state calls for."""
        camera, camera_state = planned.spec, request.camera_state
        view = self._views.get(planned)
        if not camera.effect_settings.settings:
            self._bound_frame(planned, camera_state)
            drawn = _drawn_exposure(planned, camera_state)
            image, labels = self._draw_with_labels(planned, view, drawn, request)
            return RenderedView(
                image,
                planned.plan_text,
                planned.bounds,
                choice=planned.choice,
                drawn=drawn,
                labels=labels,
            )
        plan = self._decide_effects(camera, camera_state)
        wanted = apply_scene_effects(camera_state, plan)
        limited = limit_time_samples(wanted, camera.camera, planned.plan)
        self._bound_frame(planned, limited)
        drawn = _drawn_exposure(planned, limited, plan.image_effects)
        image, labels = self._draw_with_labels(planned, view, drawn, request, plan.thresholds)
        decisions = plan.decide_by_frame(image.changes)
        self._log_decisions(planned, decisions)
        decisions = explain_limit(decisions, wanted, limited)
        return RenderedView(
            image, planned.plan_text, planned.bounds, decisions, planned.choice, drawn, labels
        )

    def _draw_with_labels(
        self,
        planned: PlannedCamera,
        view: View,
        drawn: DrawnExposure,
        request: ViewRequest,
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
    ) -> tuple[RenderedImage, PixelLabels | None]:
        """Draw an exposure, with the labels that are wanted if its rays can find them."""
        state, effects = drawn.camera_state, drawn.image_effects
        if (
            request.request_labels is not None
            and planned.plan.has_exact_rays
            and isinstance(view, LabellingView)
            and (labels := request.request_labels(drawn)) is not None
        ):
            return view.render_with_labels(state, effects, thresholds, labels)
        return view.render(state, effects, thresholds), None

    def _log_decisions(self, planned: PlannedCamera, decisions: tuple[EffectDecision, ...]) -> None:
        """Log the decisions of a camera's first frame, later those that changed."""
        # Once whole: bounds move with every pose, and viewers and `explain` show the present ones.
        if not planned.effect_decisions:
            log.info("effects:\n%s", format_decisions(decisions, {}))
        elif changes := describe_changes(planned.effect_decisions, decisions):
            log.info("effects: %s", changes)
        planned.effect_decisions = decisions

    def _bound_frame(self, planned: PlannedCamera, camera_state: CameraState) -> None:
        """Add to the bound what the scene's coordinates contribute in a camera state."""
        if planned.bounds is None:
            return
        errors = coordinate_errors(
            cast(OmniCameraSpec, planned.spec).camera, cast(RenderPlan, planned.plan)
        )
        angle_rad = self._summarizer.max_rounding_angle_rad(camera_state, errors)
        self._plans.bound_frame(planned, angle_rad)

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Plan that the next frame of a camera will have; prepares no view."""
        return self._plans.find_state(self._last_drawn.get(camera) or camera)

    def _decide_effects(self, camera: CameraSpec, camera_state: CameraState) -> EffectPlan:
        """Decide which effects a camera state calls for."""
        # Radiance bounds never change; a whole summary measures distances from the new pose.
        if needs_radiance_only(camera.effect_settings):
            summary = self._summarizer.summarize_radiance(camera_state)
        else:
            summary = self._summarizer.summarize(camera_state, camera.camera)
        return plan_effects(camera.effect_settings, summary, camera.camera)

    def close(self) -> None:
        """Close all views, and the renderers."""
        self._labeller.close()
        self._views.close()
        self._plans.forget_all()
        self._planner.close()


def _drawn_exposure(
    planned: PlannedCamera,
    camera_state: CameraState,
    image_effects: tuple[ImageEffect, ...] = (),
) -> DrawnExposure:
    return DrawnExposure(planned.spec.camera, camera_state, image_effects, planned.plan.samples)
