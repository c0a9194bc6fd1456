"""Drawn views of cameras: prepared on first use, bounded in memory, renewed after faults.

What a view shows is decided in `frame_plan`; here it is drawn, and labelled where its request wants
labels. Cameras of equal model and plan share a prepared view: targets between two candidate plans,
robots of one class. A camera without a client costs nothing, nor do labels before the first request
for a channel. Belongs to the thread that made the renderers.

* A renderer that fails is made anew. If that fails, too, another one replaces it where that is
  allowed: not under lockstep, nor after a choice by name. Else the view is refused. A decision that
  fails is no renderer's fault: that frame fails with the reason, and the renderer stays.
* Labels are found while the image is drawn where its rays and times are theirs: all channels then
  add 140 % to a clean image, by rays of their own 211 % (`tests/measurements/labels.py`).
* Freed memory goes back once 4 MiB of views are prepared or closed. Seven views of 193 MB in all,
  as clients get them by trying accuracies, left 62 MB of gaps; closing the gaps takes 0.4 to 9 ms.
  To return each large array at once saves as much and costs a frame with all effects 24 ms.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, TypeVar, cast

from catoptra_protocol.errors import CatoptraError, DomainError, RendererUnavailableError
from catoptra_protocol.labels import LABEL_CHANNELS, count_bytes
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import Channel, FrameLabels, ViewRequest
from catoptra_server.frames.frame_plan import (
    DEFAULT_CALIBRATION_STATES,
    CameraPlan,
    ErrorBoundTable,
    FramePlan,
    FramePlanner,
    ViewKey,
    ViewState,
)
from catoptra_server.frames.plan.camera import (
    CameraSpec,
    OmniCameraSpec,
    PerspectiveCameraSpec,
    hide_unseen,
)
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import PerspectivePlan
from catoptra_server.frames.renderers import RendererPool
from catoptra_server.render.renderer import RenderedImage, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.trace_engine import LabellingView, LabelRequest, PixelLabels
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.memory import LruDict, release_freed_memory
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World

if TYPE_CHECKING:
    from catoptra_server.frames.labels import LabelledImage
    from catoptra_server.frames.labels.label_renderer import LabelRenderer

log = logging.getLogger(__name__)


# Clients choose tolerances and fields of view, and each choice may need a view of its own: 25
# tolerances took 0.9 GB. Enough for 30 views of 360 x 360 px at 2 x 2 samples.
_MAX_VIEW_BYTES = 256 * 2**20
# A view of few pixels still holds tables of the scene's edges, and framebuffers on the device.
_MAX_VIEWS = 64
# Idle time after which a view is closed that no camera has of its own: a client that tries variants
# leaves no memory behind.
_MAX_IDLE_S = 8.0
# Seven views of 193 MB in all left 62 MB of gaps between them. Closing the gaps takes 0.4 to 9 ms,
# beside 30 ms or more for the rays of so many bytes.
_RELEASE_BYTES = 4 * 2**20

_ResultT = TypeVar("_ResultT")
_DecidedT = TypeVar("_DecidedT", CameraPlan, FramePlan)
_LabelRequester = Callable[["LabelledImage", tuple[str, ...]], LabelRequest | None]


class ViewFailedError(CatoptraError):
    """No renderer could draw the view; the text is for clients, the log has the traceback."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedView:
    """Image of one camera, with everything that a frame reports of the rendering."""

    image: RenderedImage
    frame_plan: FramePlan
    """Decision that the image follows."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of the camera, with what the image shows, in optical order."""
    label_channels: tuple[str, ...] = ()
    """Channels of labels that its request wants."""
    labels: PixelLabels | None = None
    """Labels that were found while the image was drawn."""


class ViewCache:
    """The views of one scene; closing them frees the renderers, too."""

    def __init__(
        self,
        planner: RenderPlanner,
        summarizer: SceneSummarizer,
        *,
        max_bytes: int = _MAX_VIEW_BYTES,
        max_views: int = _MAX_VIEWS,
        calibration_states: Sequence[CameraState] = DEFAULT_CALIBRATION_STATES,
        error_bounds: ErrorBoundTable | None = None,
        ends_measures: bool = False,
        request_labels: _LabelRequester | None = None,
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
            ends_measures: As of `FramePlanner`.
            request_labels: Labels in some channels that can be found while an image is drawn;
                None for the server's frames.
            clock: Clock in seconds that frames are timed by.
        """
        self._renderers = planner.renderers
        self._summarizer = summarizer
        self._frames = FramePlanner(
            planner,
            summarizer,
            calibration_states=calibration_states,
            error_bounds=error_bounds,
            ends_measures=ends_measures,
            clock=clock,
        )
        self._clock = clock
        self._views = _ViewStore(
            self._renderers, max_bytes=max_bytes, max_views=max_views, clock=clock
        )
        self._labeller = _FrameLabeller(self._renderers, summarizer)
        self._request_labels = request_labels or self._labeller.request

    def __len__(self) -> int:
        """Number of prepared views."""
        return len(self._views)

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Show the same triangles in other looks and light: 10 % of what new renderers take.

        Args:
            scene: Of `SceneMesh.repaint`.
            world: The world with other lights.
        """
        self._renderers.repaint(scene, world)
        self._summarizer.repaint(scene, world)

    def prepare(self, camera: CameraSpec) -> str:
        """Prepare the view of a camera ahead of the first frame, and return the plan in words.

        Raises:
            ViewFailedError: No renderer can prepare the view.
        """

        def prepare_view(camera_plan: CameraPlan) -> str:
            self._views.get(camera_plan.view_key, is_kept=True)
            self._views.trim()
            return camera_plan.plan_text

        return self._work(partial(self._frames.plan_camera, camera), prepare_view)

    def render(self, request: ViewRequest) -> RenderedView:
        """Render a view; the first frame of a camera includes the preparation.

        Raises:
            ViewFailedError: No renderer can draw the view, or its decision failed.
        """
        decide = partial(self._frames.decide, request.camera, request.camera_state)
        return self._work(decide, partial(self._draw, request))

    def _draw(self, request: ViewRequest, frame_plan: FramePlan) -> RenderedView:
        """Draw what is decided, and record it."""
        # Prepared ahead of the clock: the first frame would take longer than later ones.
        view = self._views.get(frame_plan.view_key)
        begin_s = self._clock()
        effects, labels, state = frame_plan.effects, None, frame_plan.camera_state
        if isinstance(request.camera, PerspectiveCameraSpec) and not request.label_channels:
            state = hide_unseen(state, request.camera.camera)
        arguments = state, effects.image_effects, effects.thresholds
        if (
            request.label_channels
            # Else picture and labels have different rays.
            and frame_plan.camera is frame_plan.requested
            and frame_plan.plan.has_exact_rays
            and isinstance(view, LabellingView)
            and (wanted := self._request_labels(frame_plan.labelled_image, request.label_channels))
        ):
            image, labels = view.render_with_labels(*arguments, wanted)
        else:
            image = view.render(*arguments)
        decisions = self._frames.record(frame_plan, image, 1e3 * (self._clock() - begin_s))
        self._views.trim()
        return RenderedView(image, frame_plan, decisions, request.label_channels, labels)

    def _work(
        self, decide: Callable[[], _DecidedT], draw: Callable[[_DecidedT], _ResultT]
    ) -> _ResultT:
        """Result of drawing what is decided, by a new or another renderer after a fault.

        Raises:
            ViewFailedError: No renderer can do it, or nothing could be decided.
        """
        decided = _decide(decide)
        kind = decided.plan.renderer
        try:
            return draw(decided)
        except Exception as error:
            # A request that no renderer could satisfy is no fault of this one.
            if isinstance(error, CatoptraError) and not isinstance(error, RendererUnavailableError):
                raise ViewFailedError(str(error)) from error
            log_fault(log, "%s failed to render a view and is made anew", kind.value)
        self._renew_renderer(kind)
        try:
            return draw(_decide(decide))
        except Exception:
            log_fault(log, "%s failed again after it was made anew", kind.value)
        # Whatever comes of this view, others find a renderer that works.
        self._renew_renderer(kind)
        return self._work_with_replacement(decide, draw, kind)

    def _work_with_replacement(
        self,
        decide: Callable[[], _DecidedT],
        draw: Callable[[_DecidedT], _ResultT],
        failed: RendererKind,
    ) -> _ResultT:
        """Result of some work by another renderer, which stays in use if it succeeds."""
        other = self._renderers.find_replacement(failed)
        if other is None:
            raise ViewFailedError(f"{failed.value} failed to render the view: see the server's log")
        self._renderers.replace(failed, other)
        self._frames.forget_all()
        try:
            result = draw(_decide(decide))
        except Exception as error:
            log_fault(log, "%s failed in place of %s", other.value, failed.value)
            self._renew_renderer(other)
            self._renderers.restore(failed)
            self._frames.forget_all()
            raise ViewFailedError(
                f"{failed.value} and {other.value} failed to render the view: see the server's log"
            ) from error
        log.warning("%s replaces %s, which failed twice", other.value, failed.value)
        return result

    def _renew_renderer(self, kind: RendererKind) -> None:
        # The rays of labels may be of the same renderer.
        self._labeller.close()
        self._views.close_views_of(kind)
        self._renderers.renew(kind)

    def label(self, rendered: RenderedView, channel: Channel, time_s: float) -> FrameLabels:
        """Label the pixels of a rendered view, in the channels of its request.

        Args:
            rendered: The view.
            channel: Channel of the frame, to whose last frame the flow leads.
            time_s: Simulation time of the exposure.

        Raises:
            ViewFailedError: The labels take too much memory, or no ray can be traced here.
        """
        return self._labeller.label(rendered, channel, time_s)

    def view_state(self, request: ViewRequest) -> ViewState:
        """Plan that a frame of an omnidirectional camera would have; prepares no view."""
        return self._frames.find_state(cast(OmniCameraSpec, request.camera), request.camera_state)

    def close_idle(self) -> None:
        """Close views of variants and former targets that nobody has requested for long."""
        self._views.trim()

    def close(self) -> None:
        """Close all views, and the renderers."""
        self._labeller.close()
        self._views.close()
        self._frames.close()


@dataclass(slots=True, eq=False)
class _StoredView:
    view: View
    memory_bytes: int
    used_at_s: float
    is_kept: bool
    """Whether the view stays however long it is not used: that of a camera's own plan."""


class _ViewStore:
    """The prepared views of one scene."""

    def __init__(
        self,
        renderers: RendererPool,
        *,
        max_bytes: int,
        max_views: int,
        clock: Callable[[], float],
    ) -> None:
        """Create an empty store.

        Args:
            renderers: Renderers that prepare the views.
            max_bytes: Memory above which the view used longest ago is closed; one view is kept
                whatever its size.
            max_views: Number of views above which the view used longest ago is closed.
            clock: Clock of the use, seconds.
        """
        self._clock = clock
        self._renderers = renderers
        self._max_bytes = max_bytes
        self._max_views = max_views
        self._views: dict[ViewKey, _StoredView] = {}  # the last used at the end
        self._newest: tuple[ViewKey, _StoredView] | None = None
        self._changed_bytes = 0

    def __len__(self) -> int:
        """Number of prepared views."""
        return len(self._views)

    @property
    def memory_bytes(self) -> int:
        """Memory of all views, each as of its last use; of a single view as of its preparation."""
        return sum(stored.memory_bytes for stored in self._views.values())

    def get(self, key: ViewKey, *, is_kept: bool = False) -> View:
        """View of a camera by its plan, prepared at the first use."""
        # By identity first: hashing camera and plan takes longer than all else here.
        if self._newest is not None and self._newest[0] is key:
            self._newest[1].used_at_s = self._clock()
            return self._newest[1].view
        if len(self._views) == 1:
            self._measure_newest()  # `trim` has not, as long as there was no other
        # Removed and inserted again: dicts keep the order of insertion.
        stored = self._views.pop(key, None) or self._prepare(key)
        stored.used_at_s = self._clock()
        stored.is_kept |= is_kept
        self._views[key] = stored
        self._newest = key, stored
        return stored.view

    def _prepare(self, key: ViewKey) -> _StoredView:
        camera, plan = key
        renderer = self._renderers.get(plan.renderer)
        view: View
        if isinstance(plan, PerspectivePlan):
            assert isinstance(camera, PerspectiveCamera), "a lens has a perspective plan"
            view = renderer.prepare_perspective(camera, plan.samples)
        else:
            assert isinstance(camera, OmniCamera), "a mirror has a render plan"
            view = renderer.prepare(camera, plan)
        stored = _StoredView(view, view.memory_bytes, self._clock(), is_kept=False)
        self._changed_bytes += stored.memory_bytes
        return stored

    def trim(self) -> None:
        """Close the views used longest ago, down to the limits, and those that have been idle.

        To be called after each use, and now and then without one.
        """
        # A single view stays whatever its size; to have its memory counted by the renderer's
        # library takes a quarter of the time that a frame takes here beside the drawing.
        if len(self._views) > 1:
            self._measure_newest()
        while len(self._views) > 1 and (
            len(self._views) > self._max_views or self.memory_bytes > self._max_bytes
        ):
            self._close(next(iter(self._views)))
        used_before_s = self._clock() - _MAX_IDLE_S
        for key, stored in [*self._views.items()] if len(self._views) > 1 else ():
            if stored.used_at_s < used_before_s and not stored.is_kept:
                self._close(key)
        if self._changed_bytes >= _RELEASE_BYTES:
            release_freed_memory()
            self._changed_bytes = 0

    def _measure_newest(self) -> None:
        """Record the memory of the view used last, to which effects and shadows may have added."""
        newest = next(reversed(self._views.values()))
        newest.memory_bytes = newest.view.memory_bytes

    def close_views_of(self, kind: RendererKind) -> None:
        """Close all views of one renderer."""
        for key in [key for key in self._views if key[1].renderer is kind]:
            self._close(key)

    def close(self) -> None:
        """Close all views."""
        for key in list(self._views):
            self._close(key)

    def _close(self, key: ViewKey) -> None:
        self._newest = None
        stored = self._views.pop(key)
        self._changed_bytes += stored.memory_bytes
        try:
            stored.view.close()
        except Exception:
            # Of a renderer that failed: it is closed as a whole.
            log_fault(log, "a view could not be closed")


def _decide(decide: Callable[[], _DecidedT]) -> _DecidedT:
    """Decision about a camera or a frame.

    Raises:
        ViewFailedError: There is none.
    """
    try:
        return decide()
    except CatoptraError as error:
        raise ViewFailedError(str(error)) from error
    except Exception as error:
        log_fault(log, "a frame could not be decided")
        raise ViewFailedError(
            f"the frame could not be decided, {type(error).__name__}: see the server's log"
        ) from error


# All channels of one frame: what a client accepts of an image. Frames wait one a client.
_MAX_CHANNEL_BYTES = 64 * 2**20
# Channels whose last frame a flow may lead to.
_MAX_LAST_STATES = 64


@dataclass(frozen=True, slots=True, eq=False)
class _LastExposure:
    time_s: float
    camera_state: CameraState


class _FrameLabeller:
    """Labels of the frames of one scene."""

    def __init__(self, renderers: RendererPool, summarizer: SceneSummarizer) -> None:
        """Prepare nothing yet.

        Args:
            renderers: Traces the rays.
            summarizer: Has the scene.
        """
        self._renderers = renderers
        self._summarizer = summarizer
        self._labels: LabelRenderer | None = None
        self._last: LruDict[Channel, _LastExposure] = LruDict(_MAX_LAST_STATES)

    def label(self, rendered: RenderedView, channel: Channel, time_s: float) -> FrameLabels:
        """Labels of a view; see `ViewCache.label`."""
        names, image = rendered.label_channels, rendered.frame_plan.labelled_image
        _require_room(image, names)
        last = self._last.get(channel) if "flow" in names else None
        other = None if last is None else last.camera_state
        try:
            truth = self._open_labels().render(image, names, other, rendered.labels)
        except (DomainError, RendererUnavailableError) as error:
            raise ViewFailedError(f"no labels: {error}") from error
        if "flow" in names:
            self._last.put(channel, _LastExposure(time_s, image.camera_state))
        return FrameLabels(
            truth,
            has_row_times=image.ray_source.readout_s > 0.0,
            is_displaced=any(one.name == "Misalignment" for one in image.image_effects),
            flow_to_time_s=None if last is None else last.time_s,
        )

    def request(self, image: LabelledImage, names: tuple[str, ...]) -> LabelRequest | None:
        """Labels that can be found while a view is drawn; see `LabelRenderer.request`."""
        try:
            _require_room(image, names)
            return self._open_labels().request(image, names)
        except (DomainError, RendererUnavailableError, ViewFailedError):
            # Reported by `label`, after a picture that is as good without.
            return None

    def _open_labels(self) -> LabelRenderer:
        """Labels of the scene, made at the first request."""
        if self._labels is None:
            tracer = self._renderers.get_tracer()
            # Loaded where it is needed: few servers label frames.
            from catoptra_server.frames.labels.label_renderer import LabelRenderer

            self._labels = LabelRenderer(tracer, self._summarizer.scene)
        return self._labels

    def close(self) -> None:
        """Free all rays."""
        if self._labels is not None:
            self._labels.close()
        self._labels = None


def _require_room(image: LabelledImage, names: tuple[str, ...]) -> None:
    """Raise ViewFailedError for channels that take too much memory."""
    camera = image.camera
    channels = [LABEL_CHANNELS[name] for name in names]
    size = count_bytes(channels, camera.height_px, camera.width_px)
    if size > _MAX_CHANNEL_BYTES:
        raise ViewFailedError(
            f"no labels: the channels {', '.join(names)} of {camera.width_px} x "
            f"{camera.height_px} px take {size / 2**20:.0f} MiB, more than "
            f"{_MAX_CHANNEL_BYTES // 2**20}: request fewer channels at a time"
        )
