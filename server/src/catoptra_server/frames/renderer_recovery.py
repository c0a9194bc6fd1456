"""Work of renderers that goes on after a fault.

A renderer that fails is made anew; if that fails, too, another one replaces it where that is
allowed, else the view is refused. A decision that fails is no renderer's fault: that frame fails
with its reason, and the renderer stays.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TypeVar

from catoptra_protocol.errors import CatoptraError, RendererUnavailableError
from catoptra_server.frames.frame_plan import CameraPlan, FramePlan
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.faults import log_fault

log = logging.getLogger(__name__)

_ResultT = TypeVar("_ResultT")
_PlannedT = TypeVar("_PlannedT", CameraPlan, FramePlan)


class ViewFailedError(CatoptraError):
    """No renderer could draw the view; the text is for clients, the log has the traceback."""


class RendererRecovery:
    """Renderers that are made anew after faults."""

    def __init__(
        self,
        renderers: RendererPool,
        *,
        close_views: Callable[[RendererKind], None],
        forget_plans: Callable[[], None],
    ) -> None:
        """Guard the work of some renderers.

        Args:
            renderers: The renderers.
            close_views: Closes the prepared views of a renderer.
            forget_plans: Has all cameras planned anew, with other renderers.
        """
        self._renderers = renderers
        self._close_views = close_views
        self._forget_plans = forget_plans

    def work(
        self, decide: Callable[[], _PlannedT], draw: Callable[[_PlannedT], _ResultT]
    ) -> _ResultT:
        """Result of drawing what is decided, by a new or another renderer after a fault.

        Raises:
            ViewFailedError: No renderer can do it, or nothing could be decided.
        """
        planned = _decide(decide)
        kind = planned.plan.renderer
        try:
            return draw(planned)
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
        decide: Callable[[], _PlannedT],
        draw: Callable[[_PlannedT], _ResultT],
        failed: RendererKind,
    ) -> _ResultT:
        """Result of some work by another renderer, which stays in use if it succeeds."""
        other = self._renderers.find_replacement(failed)
        if other is None:
            raise ViewFailedError(f"{failed.value} failed to render the view: see the server's log")
        self._renderers.replace(failed, other)
        self._forget_plans()
        try:
            result = draw(_decide(decide))
        except Exception as error:
            log_fault(log, "%s failed in place of %s", other.value, failed.value)
            self._renew_renderer(other)
            self._renderers.restore(failed)
            self._forget_plans()
            raise ViewFailedError(
                f"{failed.value} and {other.value} failed to render the view: see the server's log"
            ) from error
        log.warning("%s replaces %s, which failed twice", other.value, failed.value)
        return result

    def _renew_renderer(self, kind: RendererKind) -> None:
        self._close_views(kind)
        self._renderers.renew(kind)


def _decide(decide: Callable[[], _PlannedT]) -> _PlannedT:
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
