"""The render thread: frame requests become frames, one after the other, in the order of arrival.

It owns renderers and views, because an OpenGL context belongs to the thread that made it. The
simulation goes on while a frame is rendered.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_request import FrameComposition, FrameRequest, ViewRequest
from catoptra_server.frames.multi_view import compose_tiles
from catoptra_server.frames.view_cache import RenderedView, ViewState
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.render.renderer import Image

_RenderFuture = Future[None]
# Receives None from a server without cameras, which renders nothing.
PlanCallback = Callable[[ViewState | None], None]


@dataclass(frozen=True, slots=True, eq=False)
class _PlanQuery:
    """Request for the plan of a camera."""

    camera: OmniCameraSpec
    reply: PlanCallback


class ViewProvider(Protocol):
    """Source of rendered views; the server's is `ViewCache`."""

    def render(self, request: ViewRequest) -> RenderedView:
        """Render a view."""

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Plan that the next frame of a camera will have; prepares no view."""

    def close(self) -> None:
        """Close all views and renderers."""


class RenderThread:
    """A queue of frame requests; `run` is the main function of the thread that renders them."""

    def __init__(
        self, put: Callable[[Frame], None], *, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        """Create the queue.

        Args:
            put: Receives each finished frame, in the render thread.
            monotonic: Clock that frames are timed by.
        """
        self._put = put
        self._monotonic = monotonic
        self._queue: queue.SimpleQueue[tuple[FrameRequest, _RenderFuture] | _PlanQuery | None]
        self._queue = queue.SimpleQueue()
        self._end_lock = threading.Lock()
        self._has_ended = False

    def submit(self, request: FrameRequest) -> _RenderFuture:
        """Queue a request, from any thread.

        Returns:
            A future that is set after the frame was put; cancelled once the thread has ended.
        """
        future: _RenderFuture = Future()
        # Under the lock an entry is either cancelled here or found by `_cancel_pending`.
        with self._end_lock:
            if self._has_ended:
                future.cancel()
            else:
                self._queue.put((request, future))
        return future

    def submit_and_wait(self, request: FrameRequest) -> None:
        """Queue a request and wait until the frame is put: the form that lockstep needs.

        Raises:
            CancelledError: The thread had ended before.
            Exception: Whatever the renderer raised.
        """
        self.submit(request).result()

    def query_plan(self, camera: OmniCameraSpec, reply: PlanCallback) -> None:
        """Have `reply` called in the render thread with the plan of a camera.

        The queue orders the query behind the frames requested earlier, whose times may change the
        plan.
        """
        with self._end_lock:
            if not self._has_ended:
                self._queue.put(_PlanQuery(camera, reply))

    def stop(self) -> None:
        """End the thread after the requests already queued."""
        # A sentinel behind the queued requests, which are still rendered.
        self._queue.put(None)

    def run(
        self, create_views: Callable[[], ViewProvider | None], on_ready: Callable[[], None]
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
            while (entry := self._queue.get()) is not None:
                if isinstance(entry, _PlanQuery):
                    entry.reply(views.view_state(entry.camera) if views is not None else None)
                else:
                    self._render_request(*entry, views)
        finally:
            # Also after an error: the simulation may be blocked in `submit_and_wait`.
            self._cancel_pending()
            if views is not None:
                views.close()

    def _render_request(
        self, request: FrameRequest, future: _RenderFuture, views: ViewProvider | None
    ) -> None:
        try:
            self._put(render_frame(request, views, monotonic=self._monotonic))
        except Exception as error:
            # To both threads: a simulation waiting under lockstep raises the error, this one ends.
            future.set_exception(error)
            raise
        future.set_result(None)

    def _cancel_pending(self) -> None:
        """Cancel all queued requests and every later one."""
        with self._end_lock:
            self._has_ended = True
        while not self._queue.empty():
            entry = self._queue.get()
            if isinstance(entry, tuple):
                entry[1].cancel()


def render_frame(
    request: FrameRequest, views: ViewProvider | None, *, monotonic: Callable[[], float]
) -> Frame:
    """Render all views of a request and compose the frame; black without a view provider."""
    composition = request.composition
    begin_s = monotonic()
    rendered = [
        None if view is None or views is None else views.render(view) for view in composition.views
    ]
    rgb = _compose_image(composition, rendered)
    # Up to here the duration counts: the rest gathers numbers.
    end_s = monotonic()
    present = [view for view in rendered if view is not None]
    stage_ms: Counter[str] = Counter()
    for view in present:
        stage_ms.update(view.image.stage_ms)
    bounds = max_bounds(view.error_bounds for view in present)
    return Frame(
        sequence=request.sequence,
        time_s=request.time_s,
        rgb=rgb,
        exposed_at_s=request.exposed_at_s,
        finished_at_s=end_s,
        channel=request.channel,
        metadata=composition.metadata,
        stage_ms=dict(stage_ms),
        render_duration_s=end_s - begin_s,
        # A set: cameras of one class share a plan.
        plan="; ".join(sorted({view.plan for view in present})) or None,
        error_bound_px=bounds["outline_px"] if bounds else None,
        error_bounds=bounds,
        # In a list of several cameras' decisions the camera of each would be lost.
        effect_decisions=present[0].effect_decisions if len(rendered) == len(present) == 1 else (),
    )


def max_bounds(bounds: Iterable[Mapping[str, float] | None]) -> dict[str, float] | None:
    """Largest value of each error bound, over all views of a frame.

    Returns:
        The bounds by name; None for a frame without views, or with a view without bounds.
    """
    views = list(bounds)
    known = [view for view in views if view is not None]
    if not known or len(known) < len(views):
        return None
    names = dict.fromkeys(name for view in known for name in view)
    return {name: max(view.get(name, 0.0) for view in known) for name in names}


def _compose_image(composition: FrameComposition, rendered: Sequence[RenderedView | None]) -> Image:
    """Image of all tiles."""
    images = [view.image.rgb if view else None for view in rendered]
    first, layout = images[0], composition.layout
    # A single view that fills the frame is the frame: no copy of a megabyte.
    if len(images) == 1 and first is not None and first.shape[:2] == layout.shape:
        return first
    return compose_tiles(layout, images)
