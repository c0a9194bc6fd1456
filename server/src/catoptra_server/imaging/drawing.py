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

from catoptra_server.imaging.frame import Frame
from catoptra_server.imaging.multi_view import compose
from catoptra_server.imaging.shot import Eye, OmniEye, Scenery, Shot, Take
from catoptra_server.imaging.views import ViewState
from catoptra_server.plan.error_bound import ErrorBound
from catoptra_server.render.renderer import Image, RenderedImage

_Drawn = Future[None]
# None: nothing is drawn here.
Told = Callable[[ViewState | None], None]


@dataclass(frozen=True, slots=True, eq=False)
class _Question:
    """How would this be drawn?"""

    eye: OmniEye
    tell: Told


class Viewer(Protocol):
    """What draws takes: the server's is `Views`."""

    def draw(self, take: Take) -> RenderedImage:
        """Return the picture of a take."""

    def plan(self, eye: Eye) -> object:
        """Return how an eye is drawn; it prints in words."""

    def bound(self, eye: Eye) -> ErrorBound | None:
        """Return how far off outlines may be; None where there is no bound."""

    def choice(self, eye: OmniEye) -> ViewState:
        """Return how an eye will be drawn, and what that costs; it need not be prepared."""

    def close(self) -> None:
        """Free what is held."""


class Drawing:
    """A queue of shots; `run` is the whole life of the thread that draws them."""

    def __init__(
        self, put: Callable[[Frame], None], *, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._put = put
        self._monotonic = monotonic
        self._shots: queue.SimpleQueue[tuple[Shot, _Drawn] | _Question | None]
        self._shots = queue.SimpleQueue()
        self._ending = threading.Lock()
        self._has_ended = False

    def draw(self, shot: Shot) -> _Drawn:
        """Hand over a shot, from any thread; its frame is put before the result is set."""
        drawn: _Drawn = Future()
        with self._ending:
            if self._has_ended:
                drawn.cancel()
            else:
                self._shots.put((shot, drawn))
        return drawn

    def draw_and_wait(self, shot: Shot) -> None:
        """Hand over a shot; return when its frame is put: under lockstep time waits for pictures.

        Raises what drawing it raised, and CancelledError if the drawing had ended before.
        """
        self.draw(shot).result()

    def ask(self, eye: OmniEye, tell: Told) -> None:
        """Have `tell` called by the drawing thread with how an eye is drawn, after shots before."""
        with self._ending:
            if not self._has_ended:
                self._shots.put(_Question(eye, tell))

    def stop(self) -> None:
        """End the thread after the shots that were handed over."""
        self._shots.put(None)

    def run(self, make_views: Callable[[], Viewer | None], ready: Callable[[], None]) -> None:
        """Make the views, say so, and draw until told to stop; None: there are no cameras."""
        views = None
        try:
            views = make_views()
            ready()
            while (entry := self._shots.get()) is not None:
                if isinstance(entry, _Question):
                    entry.tell(views.choice(entry.eye) if views is not None else None)
                else:
                    self._draw_entry(*entry, views)
        finally:
            self._cancel_waiting()
            if views is not None:
                views.close()

    def _draw_entry(self, shot: Shot, drawn: _Drawn, views: Viewer | None) -> None:
        try:
            self._put(developed(shot, views, monotonic=self._monotonic))
        except Exception as error:
            drawn.set_exception(error)
            raise
        drawn.set_result(None)

    def _cancel_waiting(self) -> None:
        """Let nobody wait for what will not be drawn."""
        with self._ending:
            self._has_ended = True
        while not self._shots.empty():
            entry = self._shots.get()
            if isinstance(entry, tuple):
                entry[1].cancel()


def developed(shot: Shot, views: Viewer | None, *, monotonic: Callable[[], float]) -> Frame:
    """Return the frame of a shot. Without views there is nothing to look through: black."""
    scenery = shot.scenery
    begin_s = monotonic()
    pictures = [_drawn(take, views) for take in scenery.takes]
    rgb = _whole(scenery, pictures)
    stage_ms: Counter[str] = Counter()
    for picture in pictures:
        stage_ms.update(picture.stage_ms if picture else {})
    end_s = monotonic()
    eyes = {take.eye for take in scenery.takes if take is not None}
    plans = {str(views.plan(eye)) for eye in eyes} if views is not None else set()
    bound = worst([views.bound(eye) for eye in eyes]) if views is not None else None
    return Frame(
        sequence=shot.sequence,
        time_s=shot.time_s,
        rgb=rgb,
        exposed_s=shot.exposed_s,
        finished_s=end_s,
        channel=shot.channel,
        caption=scenery.caption,
        stage_ms=dict(stage_ms),
        drawn_s=end_s - begin_s,
        plan="; ".join(sorted(plans)) or None,
        error_bound_px=bound["outline_px"] if bound else None,
        bound=bound,
        effects=pictures[0].effects if len(pictures) == 1 and pictures[0] else (),
    )


def worst(bounds: Sequence[ErrorBound | None]) -> dict[str, float] | None:
    """Return the largest of each number, of all pictures that a frame consists of.

    None where there is no picture, or one without a bound.
    """
    numbers = [bound.as_dict() for bound in bounds if bound is not None]
    if not numbers or len(numbers) < len(bounds):
        return None
    names = dict.fromkeys(name for one in numbers for name in one)
    return {name: max(one.get(name, 0.0) for one in numbers) for name in names}


def _drawn(take: Take | None, views: Viewer | None) -> RenderedImage | None:
    return None if take is None or views is None else views.draw(take)


def _whole(scenery: Scenery, pictures: list[RenderedImage | None]) -> Image:
    """Return one picture of all tiles; the only tile's own where it fills the screen."""
    first = pictures[0] if len(pictures) == 1 else None
    size = (scenery.layout.height_px, scenery.layout.width_px)
    if first is not None and first.rgb.shape[:2] == size:
        return first.rgb
    return compose(scenery.layout, [picture.rgb if picture else None for picture in pictures])
