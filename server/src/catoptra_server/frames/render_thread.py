"""The render thread: frame requests become frames, one after the other.

The thread owns the views, because an OpenGL context belongs to one thread; the simulation goes on
meanwhile. Clients share the time of the thread, as measured: one whose frames take long waits
behind the others, whatever it names the cameras, variants and labels that it requests. Each client
that waits for a frame pays for it, so that a camera with many viewers has no more of the time than
one with a single viewer. A frame that nobody waits for any more is not drawn. A channel whose frame
fails is rejected with the reason, and the others go on.

* A failing channel rests for a second, then twice as long each time, up to a minute: a failed frame
  costs more than others, since renderers are made anew. Under lockstep each is tried.
* At most one query of a plan is answered a frame, so that neither kind of work starves the other.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from typing import Protocol

import numpy as np

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.frame import (
    Channel,
    Frame,
    FrameComposition,
    FrameRequest,
    ViewRequest,
    append_difference,
)
from catoptra_server.frames.frame_plan import ViewState
from catoptra_server.frames.multi_view import compose_tiles
from catoptra_server.frames.views import RenderedView, ViewCache, ViewFailedError
from catoptra_server.render.renderer import Image
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.queues import FairQueue

log = logging.getLogger(__name__)

# Part of the thread's time that one client may use before others come first.
_CLIENT_SHARE = 0.1
# Longest pause between two requests of a viewer that requests frame after frame. A frame that takes
# longer, as the first one of an expensive accuracy target does, leaves such a viewer time.
_PATIENCE_S = 0.2
# Frames that take longer count up to four times: while one is drawn nobody else has a frame.
_LONG_FRAME_S = 0.05
_MAX_WEIGHT = 4.0
# Interval at which a long frame is tried again that waits for such a viewer.
_RETRY_S = 0.01
# Time without work after which idle views are closed.
_IDLE_S = 5.0


@dataclass(frozen=True, slots=True)
class PlanFailure:
    """Reply to a plan query without a plan."""

    reason: str
    """Text for the client."""


PlanCallback = Callable[[ViewState | PlanFailure], None]


class RenderThread:
    """A queue of frame requests; `run` is the main function of the thread that renders them."""

    def __init__(
        self,
        sink: _FrameSink,
        *,
        is_lockstep: bool = False,
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the queue.

        Args:
            sink: Receives the frame or the rejection of each request.
            is_lockstep: Render every request at once, as lockstep needs, which waits for each
                and whose frames must not depend on the time; otherwise a channel rests after a
                failure, and after a long frame where other channels have viewers.
            monotonic: Clock that frames are timed by.
        """
        self._sink = sink
        self._monotonic = monotonic
        self._backoff = None if is_lockstep else _ChannelBackoff(monotonic)
        # Guards all below.
        self._changed = threading.Condition()
        self._frames: FairQueue[Hashable, _PendingFrame] = FairQueue(
            share=_CLIENT_SHARE,
            patience_s=0.0 if is_lockstep else _PATIENCE_S,
            monotonic=monotonic,
        )
        self._plans: dict[Hashable, _PlanQuery] = {}
        self._new_views: Callable[[], ViewCache | None] | None = None
        # Channels drawn since the views were replaced; None where they never were.
        self._redrawn: set[Channel] | None = None
        self._is_stopping = False
        self._has_ended = False

    def submit(self, request: FrameRequest) -> None:
        """Queue a request, from any thread; dropped once the thread has ended."""
        self._put(request, None)

    def submit_and_wait(self, request: FrameRequest) -> None:
        """Queue a request and wait for the answer: the form that lockstep needs.

        Raises:
            CancelledError: The thread has ended.
        """
        future: Future[None] = Future()
        self._put(request, future)
        future.result()

    def _put(self, request: FrameRequest, future: Future[None] | None) -> None:
        clients = self._sink.find_clients(request.channel)
        with self._changed:
            # Under the lock a request is either cancelled here or found by `_cancel_pending`.
            if not self._has_ended:
                payer = self._frames.find_payer(clients or {request.channel})
                self._frames.put(payer, (request, future))
                self._changed.notify()
            elif future is not None:
                future.cancel()

    def query_plan(self, client: Hashable, request: ViewRequest, reply: PlanCallback) -> None:
        """Have `reply` called in the render thread with the plan of an omnidirectional camera.

        A newer query of the same client supersedes one that is waiting, which gets a PlanFailure.
        """
        with self._changed:
            if self._has_ended:
                return
            superseded = self._plans.pop(client, None)
            self._plans[client] = _PlanQuery(request, reply)
            self._changed.notify()
        if superseded is not None:
            superseded.reply(PlanFailure("superseded by a newer request"))

    def replace_views(self, create_views: Callable[[], ViewCache | None]) -> None:
        """Have the views created anew before the next frame, since the scene looks different now.

        From any thread. No earlier frame is repeated.
        """
        with self._changed:
            self._new_views = create_views
            self._changed.notify()

    def stop(self) -> None:
        """End the thread after the frame that is being rendered; others are cancelled."""
        with self._changed:
            self._is_stopping = True
            self._changed.notify()

    def run(
        self, create_views: Callable[[], ViewCache | None], on_ready: Callable[[], None]
    ) -> None:
        """Create the views, call `on_ready`, and render until stopped.

        Args:
            create_views: Called in this thread; None from a server without cameras.
            on_ready: Called in this thread once the views exist.
        """
        views = None
        try:
            views = create_views()
            on_ready()
            while self._serve_queue(views):
                if views is not None:
                    views.close()
                views = None
                views, self._redrawn = self._take_new_views()(), set()
        finally:
            # Also after an error: the simulation may be blocked in `submit_and_wait`.
            self._cancel_pending()
            if views is not None:
                views.close()

    def _take_new_views(self) -> Callable[[], ViewCache | None]:
        with self._changed:
            create_views, self._new_views = self._new_views, None
        assert create_views is not None, "the queue is left for new views alone"
        return create_views

    def _serve_queue(self, views: ViewCache | None) -> bool:
        """Answer requests until stopped, or until the views are to be replaced: then True."""
        while True:
            with self._changed:
                has_work = self._changed.wait_for(
                    lambda: (
                        self._is_stopping or self._new_views or len(self._frames) or self._plans
                    ),
                    _IDLE_S,
                )
                if self._is_stopping:
                    return False
                if self._new_views:
                    return True
                pending = self._frames.take()
                query = self._plans.pop(next(iter(self._plans))) if self._plans else None
                if pending is None and query is None and has_work:
                    self._changed.wait(_RETRY_S)
                    continue
            if not has_work and views is not None:
                views.close_idle()
            # At most one plan a frame: neither a flood of one kind keeps the other waiting.
            if pending is not None:
                self._answer_frame(*pending[1], views)
            if query is not None:
                query.reply(_find_plan(query.request, views))

    def _answer_frame(
        self, request: FrameRequest, future: Future[None] | None, views: ViewCache | None
    ) -> None:
        """Put the frame of a request, or reject the channel."""
        clients = self._sink.find_clients(request.channel)
        # Under lockstep every request is drawn: frames must not depend on who has left.
        if clients is None and future is None:
            self._sink.drop_frame(request.channel)
            return
        is_current = self._redrawn is None or request.channel in self._redrawn
        if request.repeats is not None and is_current and self._sink.repeat(request):
            return
        begin_s = self._monotonic()
        reason = self._render_or_fail(request, views)
        if reason:
            self._sink.fail_frame(request.channel, reason)
        if future is not None:
            future.set_result(None)
        duration_s = self._monotonic() - begin_s
        weight = min(max(1.0, duration_s / _LONG_FRAME_S), _MAX_WEIGHT)
        with self._changed:
            for client in clients or {request.channel}:
                self._frames.charge(client, duration_s, weight=weight)

    def _render_or_fail(self, request: FrameRequest, views: ViewCache | None) -> str:
        """Render and put a frame; the reason of a failure, empty after success."""
        channel, backoff = request.channel, self._backoff
        reason = backoff.find_reason(channel) if backoff else ""
        if reason:
            return reason
        try:
            self._sink.put(render_frame(request, views, monotonic=self._monotonic))
            if self._redrawn is not None:
                self._redrawn.add(channel)
        except Exception as error:
            if isinstance(error, ViewFailedError):
                reason = str(error)  # logged where it was raised
            else:
                log_fault(log, "the frame of %s could not be rendered", channel)
                reason = "the frame could not be rendered: see the server's log"
            if backoff:
                backoff.record_failure(channel, reason)
            return reason
        if backoff:
            backoff.record_success(channel)
        return ""

    def _cancel_pending(self) -> None:
        """Cancel all queued requests and every later one."""
        with self._changed:
            self._has_ended = True
            pending, self._plans = self._frames.clear(), {}
        for _, future in pending:
            if future is not None:
                future.cancel()


def render_frame(
    request: FrameRequest, views: ViewCache | None, *, monotonic: Callable[[], float]
) -> Frame:
    """Render all views of a request and compose the frame; black without a view provider."""
    composition = request.composition
    begin_s = monotonic()
    rendered = [
        None if view is None or views is None else views.render(view) for view in composition.views
    ]
    rgb = _turn(composition, _compose_image(composition, rendered))
    difference = None
    if composition.reference is not None and views is not None:
        reference = views.render(composition.reference)
        reference_rgb = _turn(composition, reference.image.rgb)
        rgb, difference = append_difference(rgb, reference_rgb, reference.frame_plan.plan_text)
    labels = None
    if rendered[0] is not None and views is not None and rendered[0].label_channels:
        labels = views.label(rendered[0], request.channel, request.time_s)
        labels = labels.turn() if composition.is_turned else labels
    # Up to here the duration counts: the rest gathers numbers.
    end_s = monotonic()
    present = [view for view in rendered if view is not None]
    single = present[0] if len(rendered) == len(present) == 1 else None
    bounds = _max_bounds(view.frame_plan.bounds for view in present)
    return Frame(
        sequence=request.sequence,
        time_s=request.time_s,
        rgb=rgb,
        exposed_at_s=request.exposed_at_s,
        finished_at_s=end_s,
        channel=request.channel,
        metadata=composition.metadata,
        stage_ms=_sum_stages(present),
        render_duration_s=end_s - begin_s,
        # A set: cameras of one class share a plan.
        plan="; ".join(sorted({view.frame_plan.plan_text for view in present})) or None,
        error_bound_px=bounds["outline_px"] if bounds else None,
        error_bounds=bounds,
        # In a list of several cameras' decisions the camera of each would be lost.
        effect_decisions=single.effect_decisions if single else (),
        choice=single.frame_plan.choice if single else None,
        difference=difference,
        labels=labels,
    )


class _FrameSink(Protocol):
    """Destination of frames and rejections, in the render thread; the server's is `Mailboxes`."""

    def put(self, frame: Frame) -> None:
        """Receive a finished frame."""

    def repeat(self, request: FrameRequest) -> bool:
        """Put the last frame once more; False where that is gone."""

    def fail_frame(self, channel: Channel, reason: str) -> None:
        """Receive the rejection of a request, with a reason for clients."""

    def drop_frame(self, channel: Channel) -> None:
        """Receive that a request was not drawn, since nobody waited for it."""

    def find_clients(self, channel: Channel) -> Collection[Hashable] | None:
        """Clients that a frame of a channel is for; None if nobody waits for it."""


# A request, and the future that is set after the frame was put or rejected; None if nobody waits.
_PendingFrame = tuple[FrameRequest, Future[None] | None]


@dataclass(frozen=True, slots=True, eq=False)
class _PlanQuery:
    """Request for the plan of a camera."""

    request: ViewRequest
    reply: PlanCallback


def _find_plan(request: ViewRequest, views: ViewCache | None) -> ViewState | PlanFailure:
    if views is None:
        return PlanFailure("this server has no camera")
    try:
        return views.view_state(request)
    except Exception:
        log_fault(log, "no plan was found for a camera")
        return PlanFailure("an internal fault ended the planning: see the server's log")


_FIRST_PAUSE_S = 1.0
_MAX_PAUSE_S = 60.0
# Channels are named by clients.
_MAX_CHANNELS = 64


@dataclass(frozen=True, slots=True)
class _Pause:
    until_s: float
    length_s: float
    reason: str


class _ChannelBackoff:
    """Pauses of failing channels."""

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self._monotonic = monotonic
        self._pauses: dict[Channel, _Pause] = {}

    def find_reason(self, channel: Channel) -> str:
        """Reason why no frame of a channel is to be rendered now; empty for none."""
        pause = self._pauses.get(channel)
        return pause.reason if pause and self._monotonic() < pause.until_s else ""

    def record_failure(self, channel: Channel, reason: str) -> None:
        """Pause a channel, twice as long as the last time."""
        last = self._pauses.pop(channel, None)
        length_s = min(2.0 * last.length_s, _MAX_PAUSE_S) if last else _FIRST_PAUSE_S
        while len(self._pauses) >= _MAX_CHANNELS:
            self._pauses.pop(next(iter(self._pauses)))
        self._pauses[channel] = _Pause(self._monotonic() + length_s, length_s, reason)

    def record_success(self, channel: Channel) -> None:
        """End the pauses of a channel."""
        self._pauses.pop(channel, None)


def _sum_stages(views: Sequence[RenderedView]) -> dict[str, float]:
    """Milliseconds of each stage, over all views of a frame."""
    stage_ms: dict[str, float] = {}
    for view in views:
        for name, ms in view.image.stage_ms.items():
            stage_ms[name] = stage_ms.get(name, 0.0) + ms
    return stage_ms


def _max_bounds(bounds: Iterable[Mapping[str, float] | None]) -> dict[str, float] | None:
    """Largest value of each error bound, over all views of a frame.

    Returns:
        The bounds by name; None for a frame without views, or with a view without bounds.
    """
    views = list(bounds)
    known = [view for view in views if view is not None]
    if not known or len(known) < len(views):
        return None
    if len(known) == 1:  # of most frames: 10 microseconds less
        return dict(known[0])
    names = dict.fromkeys(name for view in known for name in view)
    return {name: max(view.get(name, 0.0) for view in known) for name in names}


def _turn(composition: FrameComposition, image: Image) -> Image:
    """The image, turned round left to right where the composition says so."""
    # A copy: encoders and raw frames want rows without gaps.
    return np.ascontiguousarray(image[:, ::-1]) if composition.is_turned else image


def _compose_image(composition: FrameComposition, rendered: Sequence[RenderedView | None]) -> Image:
    """Image of all tiles."""
    images = [view.image.rgb if view else None for view in rendered]
    first, layout = images[0], composition.layout
    # A single view that fills the frame is the frame: no copy of a megabyte.
    if len(images) == 1 and first is not None and first.shape[:2] == layout.shape:
        return first
    return compose_tiles(layout, images)
