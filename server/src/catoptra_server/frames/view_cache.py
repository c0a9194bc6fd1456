"""Drawn views of cameras: prepared on first use, and drawn again after a fault of a renderer.

What a view shows is decided in `frame_plan`; here it is drawn. A camera without a client costs
nothing. Belongs to the thread that made the renderers.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame_labeller import FrameLabeller
from catoptra_server.frames.frame_labels import FrameLabels
from catoptra_server.frames.frame_plan import (
    DEFAULT_CALIBRATION_STATES,
    CameraPlan,
    ErrorBoundTable,
    FramePlan,
    FramePlanner,
    ViewState,
)
from catoptra_server.frames.frame_request import Channel, LabelRequester, ViewRequest
from catoptra_server.frames.renderer_recovery import RendererRecovery
from catoptra_server.frames.view_store import MAX_VIEW_BYTES, MAX_VIEWS, ViewStore
from catoptra_server.ground_truth.label_rays import DrawnExposure
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.render.renderer import RenderedImage, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.trace_engine import LabellingView, LabelRequest, PixelLabels
from catoptra_server.world.camera_state import CameraState


@dataclass(frozen=True, slots=True, eq=False)
class RenderedView:
    """Image of one camera, with everything that a frame reports of the rendering."""

    image: RenderedImage
    frame_plan: FramePlan
    """Decision that the image follows."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of the camera, with what the image shows, in optical order."""
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
            calibration_states: As of `FramePlanner`.
            error_bounds: As of `FramePlanner`.
            clock: Clock in seconds that frames are timed by.
        """
        self._frames = FramePlanner(
            planner,
            summarizer,
            calibration_states=calibration_states,
            error_bounds=error_bounds,
            clock=clock,
        )
        self._clock = clock
        self._views = ViewStore(planner.renderers, max_bytes=max_bytes, max_views=max_views)
        self._labeller = FrameLabeller(planner.renderers, summarizer)
        self._recovery = RendererRecovery(
            planner.renderers,
            close_views=self._close_views_of,
            forget_plans=self._frames.forget_all,
        )

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

        def prepare_view(camera_plan: CameraPlan) -> str:
            self._views.get(camera_plan.view_key)
            self._views.trim()
            return camera_plan.plan_text

        return self._recovery.work(partial(self._frames.plan_camera, camera), prepare_view)

    def render(self, request: ViewRequest) -> RenderedView:
        """Render a view; the first frame of a camera includes the preparation.

        Raises:
            ViewFailedError: No renderer can draw the view, or its decision failed.
        """
        decide = partial(self._frames.decide, request.camera, request.camera_state)
        return self._recovery.work(decide, partial(self._draw, request.request_labels))

    def _draw(self, request_labels: LabelRequester | None, frame_plan: FramePlan) -> RenderedView:
        """Draw what is decided, and record it."""
        # Prepared ahead of the clock: the first frame's time is not that of the later ones.
        view = self._views.get(frame_plan.view_key)
        begin_s = self._clock()
        image, labels = _draw_with_labels(view, frame_plan, request_labels)
        decisions = self._frames.record(frame_plan, image, 1e3 * (self._clock() - begin_s))
        self._views.trim()
        return RenderedView(image, frame_plan, decisions, labels)

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
        exposure = rendered.frame_plan.exposure
        return self._labeller.label(exposure, channels, channel, time_s, rendered.labels)

    def request_labels(
        self, channels: tuple[str, ...], exposure: DrawnExposure
    ) -> LabelRequest | None:
        """Labels of channels that can be found while a view is drawn; see `ViewRequest`."""
        return self._labeller.request(exposure, channels)

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Plan that the next frame of a camera will have; prepares no view."""
        return self._frames.find_state(camera)

    def close(self) -> None:
        """Close all views, and the renderers."""
        self._labeller.close()
        self._views.close()
        self._frames.close()


def _draw_with_labels(
    view: View, frame_plan: FramePlan, request_labels: LabelRequester | None
) -> tuple[RenderedImage, PixelLabels | None]:
    """Draw an exposure, with the labels that are wanted if its rays can find them."""
    effects = frame_plan.effects
    arguments = frame_plan.camera_state, effects.image_effects, effects.thresholds
    if (
        request_labels is not None
        # Else the rays are not those of the camera that is labelled.
        and frame_plan.camera is frame_plan.requested
        and frame_plan.plan.has_exact_rays
        and isinstance(view, LabellingView)
        and (labels := request_labels(frame_plan.exposure)) is not None
    ):
        return view.render_with_labels(*arguments, labels)
    return view.render(*arguments), None
