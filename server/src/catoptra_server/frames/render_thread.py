"""The drawing thread's work: shots become frames, one after the other, as they come.

It owns renderer and views, because an OpenGL context belongs to the thread that made it. The
simulation goes on while a shot is drawn.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol

from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_request import (
    CameraSpec,
    FrameComposition,
    FrameRequest,
    OmniCameraSpec,
    ViewRequest,
)
from catoptra_server.frames.multi_view import compose_tiles
from catoptra_server.frames.view_cache import ViewState
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.render.renderer import Image, RenderedImage

_RenderFuture = Future[None]
# None: nothing is drawn here.
PlanCallback = Callable[[ViewState | None], None]


@dataclass(frozen=True, slots=True, eq=False)
class _PlanQuery:
    """How would this be drawn?"""

    camera: OmniCameraSpec
    reply: PlanCallback


class ViewProvider(Protocol):
    """What draws takes: the server's is `ViewCache`."""

    def render(self, request: ViewRequest) -> RenderedImage:
        """Return the picture of a take."""

    def plan(self, camera: CameraSpec) -> object:
        """Return how an eye is drawn; it prints in words."""

    def error_bound(self, camera: CameraSpec) -> ErrorBound | None:
        """Return how far off outlines may be; None where there is no bound."""

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Return how an eye will be drawn, and what that costs; it need not be prepared."""

    def close(self) -> None:
        """Free what is held."""


class RenderThread:
    """A queue of shots; `run` is the whole life of the thread that draws them."""

    def __init__(
        self, put: Callable[[Frame], None], *, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._put = put
        self._monotonic = monotonic
        self._queue: queue.SimpleQueue[tuple[FrameRequest, _RenderFuture] | _PlanQuery | None]
        self._queue = queue.SimpleQueue()
        self._end_lock = threading.Lock()
        self._has_ended = False

    def submit(self, request: FrameRequest) -> _RenderFuture:
        """Hand over a shot, from any thread; its frame is put before the result is set."""
        drawn: _RenderFuture = Future()
        with self._end_lock:
            if self._has_ended:
                drawn.cancel()
            else:
                self._queue.put((request, drawn))
        return drawn

    def submit_and_wait(self, request: FrameRequest) -> None:
        """Hand over a shot; return when its frame is put: under lockstep time waits for pictures.

        Raises what drawing it raised, and CancelledError if the drawing had ended before.
        """
        self.submit(request).result()

    def query_plan(self, camera: OmniCameraSpec, reply: PlanCallback) -> None:
        """Have `tell` called by the drawing thread with how an eye is drawn, after shots before."""
        with self._end_lock:
            if not self._has_ended:
                self._queue.put(_PlanQuery(camera, reply))

    def stop(self) -> None:
        """End the thread after the shots that were handed over."""
        self._queue.put(None)

    def run(
        self, create_views: Callable[[], ViewProvider | None], on_ready: Callable[[], None]
    ) -> None:
        """Make the views, say so, and draw until told to stop; None: there are no cameras."""
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
            self._cancel_pending()
            if views is not None:
                views.close()

    def _render_request(
        self, request: FrameRequest, future: _RenderFuture, views: ViewProvider | None
    ) -> None:
        try:
            self._put(render_frame(request, views, monotonic=self._monotonic))
        except Exception as error:
            future.set_exception(error)
            raise
        future.set_result(None)

    def _cancel_pending(self) -> None:
        """Let nobody wait for what will not be drawn."""
        with self._end_lock:
            self._has_ended = True
        while not self._queue.empty():
            entry = self._queue.get()
            if isinstance(entry, tuple):
                entry[1].cancel()


def render_frame(
    request: FrameRequest, views: ViewProvider | None, *, monotonic: Callable[[], float]
) -> Frame:
    """Return the frame of a shot. Without views there is nothing to look through: black."""
    scenery = request.composition
    begin_s = monotonic()
    pictures = [_render_view(take, views) for take in scenery.views]
    rgb = _compose_image(scenery, pictures)
    stage_ms: Counter[str] = Counter()
    for picture in pictures:
        stage_ms.update(picture.stage_ms if picture else {})
    end_s = monotonic()
    eyes = {take.camera for take in scenery.views if take is not None}
    plans = {str(views.plan(eye)) for eye in eyes} if views is not None else set()
    bound = max_bounds([views.error_bound(eye) for eye in eyes]) if views is not None else None
    return Frame(
        sequence=request.sequence,
        time_s=request.time_s,
        rgb=rgb,
        exposed_at_s=request.exposed_at_s,
        finished_at_s=end_s,
        channel=request.channel,
        metadata=scenery.metadata,
        stage_ms=dict(stage_ms),
        render_duration_s=end_s - begin_s,
        plan="; ".join(sorted(plans)) or None,
        error_bound_px=bound["outline_px"] if bound else None,
        error_bounds=bound,
        effect_decisions=pictures[0].effects if len(pictures) == 1 and pictures[0] else (),
    )


def max_bounds(bounds: Sequence[ErrorBound | None]) -> dict[str, float] | None:
    """Return the largest of each number, of all pictures that a frame consists of.

    None where there is no picture, or one without a bound.
    """
    numbers = [bound.as_dict() for bound in bounds if bound is not None]
    if not numbers or len(numbers) < len(bounds):
        return None
    names = dict.fromkeys(name for one in numbers for name in one)
    return {name: max(one.get(name, 0.0) for one in numbers) for name in names}


def _render_view(request: ViewRequest | None, views: ViewProvider | None) -> RenderedImage | None:
    return None if request is None or views is None else views.render(request)


def _compose_image(composition: FrameComposition, images: list[RenderedImage | None]) -> Image:
    """Return one picture of all tiles; the only tile's own where it fills the screen."""
    first = images[0] if len(images) == 1 else None
    size = (composition.layout.height_px, composition.layout.width_px)
    if first is not None and first.rgb.shape[:2] == size:
        return first.rgb
    return compose_tiles(
        composition.layout, [picture.rgb if picture else None for picture in images]
    )
