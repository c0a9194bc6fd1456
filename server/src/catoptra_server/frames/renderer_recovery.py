"""Work of renderers that goes on after a fault.

A renderer that fails is made anew; if that fails, too, another one replaces it where that is
allowed, else the view is refused.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TypeVar

from catoptra_protocol.errors import CatoptraError, RendererUnavailableError
from catoptra_server.fault_log import log_fault
from catoptra_server.frames.camera_plans import CameraPlans
from catoptra_server.frames.planned_camera import PlannedCamera
from catoptra_server.planning.camera_spec import CameraSpec
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.render.renderer_kind import RendererKind

log = logging.getLogger(__name__)

_ResultT = TypeVar("_ResultT")


class ViewFailedError(CatoptraError):
    """No renderer could draw the view; the text is for clients, the log has the traceback."""


class RendererRecovery:
    """Plans and renderers that are made anew after faults."""

    def __init__(
        self,
        planner: RenderPlanner,
        plans: CameraPlans,
        *,
        close_views: Callable[[RendererKind], None],
    ) -> None:
        """Guard the work of a planner's renderers.

        Args:
            planner: Owner of the renderers.
            plans: Plans of the cameras, made anew with other renderers.
            close_views: Closes the prepared views of a renderer.
        """
        self._planner = planner
        self._plans = plans
        self._close_views = close_views

    def work(self, camera: CameraSpec, work: Callable[[PlannedCamera], _ResultT]) -> _ResultT:
        """Result of some work for a camera, by a new or another renderer after a fault.

        Raises:
            ViewFailedError: No renderer can do it.
        """
        planned = self._find_plan(camera)
        kind = planned.plan.renderer
        try:
            return work(planned)
        except Exception as error:
            # A request that no renderer could satisfy is no fault of this one.
            if isinstance(error, CatoptraError) and not isinstance(error, RendererUnavailableError):
                raise ViewFailedError(str(error)) from error
            log_fault(log, "%s failed to render a view and is made anew", kind.value)
        self._renew_renderer(kind)
        try:
            return work(self._find_plan(camera))
        except Exception:
            log_fault(log, "%s failed again after it was made anew", kind.value)
        # Whatever comes of this view, others find a renderer that works.
        self._renew_renderer(kind)
        return self._work_with_replacement(camera, work, kind)

    def _work_with_replacement(
        self, camera: CameraSpec, work: Callable[[PlannedCamera], _ResultT], failed: RendererKind
    ) -> _ResultT:
        """Result of some work by another renderer, which stays in use if it succeeds."""
        other = self._planner.renderers.find_replacement(failed)
        if other is None:
            raise ViewFailedError(f"{failed.value} failed to render the view: see the server's log")
        self._planner.renderers.replace(failed, other)
        self._discard_plans()
        try:
            result = work(self._find_plan(camera))
        except Exception as error:
            log_fault(log, "%s failed in place of %s", other.value, failed.value)
            self._renew_renderer(other)
            self._planner.renderers.restore(failed)
            self._discard_plans()
            raise ViewFailedError(
                f"{failed.value} and {other.value} failed to render the view: see the server's log"
            ) from error
        log.warning("%s replaces %s, which failed twice", other.value, failed.value)
        return result

    def _renew_renderer(self, kind: RendererKind) -> None:
        self._close_views(kind)
        self._planner.renderers.renew(kind)

    def _discard_plans(self) -> None:
        """Plan all cameras anew, with other renderers."""
        self._plans.forget_all()
        self._planner.discard_tables()

    def _find_plan(self, camera: CameraSpec) -> PlannedCamera:
        """Camera with its plan.

        Raises:
            ViewFailedError: No plan was found.
        """
        try:
            return self._plans.find(camera)
        except CatoptraError as error:
            raise ViewFailedError(str(error)) from error
        except Exception as error:
            log_fault(log, "no plan was found for a camera")
            raise ViewFailedError("no plan was found: see the server's log") from error
