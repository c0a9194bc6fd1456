"""Trials of the other renderer: frames of both in turn, drawn beside the frames of clients.

In pauses a trial goes on frame by frame; while clients request frames it takes a small share of the
time. Nobody receives its frames. Belongs to the thread of the renderers.
"""

from __future__ import annotations

import logging
import statistics
from collections import deque
from collections.abc import Callable
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.fault_log import log_fault
from catoptra_server.frames.planned_camera import PlannedCamera
from catoptra_server.planning.budget_monitor import BudgetMonitor
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.render.renderer_kind import RendererKind

log = logging.getLogger(__name__)

# Share of the time that a trial may take while clients request frames.
MAX_SHARE = 0.05
# The first frame of a renderer on software OpenGL, which compiles its programs: 0.4 to 0.8 s.
_FIRST_STEP_S = 0.6
# The first frames find caches cold and, in raster, machine code to be compiled.
NUM_WARM_UP_ROUNDS = 2
NUM_ROUNDS = 7

DrawFrame = Callable[[PlannedCamera, CameraState], object]


@dataclass(slots=True, eq=False)
class _Trial:
    """Frames of one camera by two plans, in turn."""

    spec: OmniCameraSpec
    camera_state: CameraState
    rival: PlannedCamera
    own: PlannedCamera
    frames_ms: dict[RendererKind, list[float]] = field(default_factory=dict)
    num_drawn: int = 0
    is_rival_new: bool = True
    """Whether no other camera uses the rival's renderer."""

    @property
    def next_plan(self) -> PlannedCamera:
        """Plan of the next frame."""
        return self.own if self.num_drawn % 2 else self.rival

    @property
    def is_finished(self) -> bool:
        """Whether all frames are drawn."""
        return self.num_drawn == 2 * (NUM_WARM_UP_ROUNDS + NUM_ROUNDS)

    def record_frame(self, frame_ms: float) -> None:
        """Record the time of the next plan's frame."""
        if self.num_drawn >= 2 * NUM_WARM_UP_ROUNDS:
            self.frames_ms.setdefault(self.next_plan.plan.renderer, []).append(frame_ms)
        self.num_drawn += 1

    @property
    def medians_ms(self) -> dict[RendererKind, float]:
        """Median milliseconds of each renderer's frames."""
        return {kind: statistics.median(frames) for kind, frames in self.frames_ms.items()}


class RendererTrials:
    """Trials of the cameras of one scene, one after the other."""

    def __init__(
        self,
        planner: RenderPlanner,
        *,
        draw: DrawFrame,
        plan_anew: Callable[[OmniCameraSpec], None],
        close_views: Callable[[RendererKind], None],
        clock: Callable[[], float],
    ) -> None:
        """Create trials of no camera.

        Args:
            planner: Has the renderers and their measured times.
            draw: Draws a frame by a plan.
            plan_anew: Has the next frame of a camera planned anew.
            close_views: Closes all views of a renderer.
            clock: Clock in seconds.
        """
        self._planner = planner
        self._draw = draw
        self._plan_anew = plan_anew
        self._close_views = close_views
        self._clock = clock
        self._last: tuple[PlannedCamera, CameraState] | None = None
        self._trial: _Trial | None = None
        self._begin_s = self._spent_s = 0.0
        # Of either renderer: which one is next makes no difference to the waiting time.
        self._steps_s: deque[float] = deque(maxlen=2)

    def record_frame(
        self, planned: PlannedCamera, camera_state: CameraState, frame_ms: float
    ) -> None:
        """Record a frame that was drawn for a client."""
        if isinstance(planned.spec, OmniCameraSpec):
            self._planner.preferences.record_frame(planned.spec, frame_ms)
            self._last = planned, camera_state

    def work(self, *, is_idle: bool) -> bool:
        """Draw a frame of a trial, where one is due and there is time.

        Args:
            is_idle: Whether no client has requested a frame for a while.

        Returns:
            Whether there is a trial to go on with.
        """
        if self._trial is None:
            self._trial = self._find_trial()
            self._begin_s, self._spent_s = self._clock(), 0.0
            self._steps_s.append(_FIRST_STEP_S)
        if self._trial is None:
            return False
        if is_idle or self._has_share():
            self._take_step(self._trial)
        return self._trial is not None

    def cancel(self) -> None:
        """End the trial without a result: the renderers have changed."""
        self._trial = self._last = None

    def _has_share(self) -> bool:
        """Whether the next frame stays within the share of the time."""
        elapsed_s = self._clock() - self._begin_s
        return self._spent_s + max(self._steps_s) <= MAX_SHARE * elapsed_s

    def _find_trial(self) -> _Trial | None:
        """Trial of the camera that was drawn last, where its renderer could be the slower one."""
        if self._last is None:
            return None
        planned, camera_state = self._last
        spec, kind = planned.spec, planned.plan.renderer
        assert isinstance(spec, OmniCameraSpec), "other cameras are not recorded"
        rival = self._planner.find_rival(spec, kind)
        if rival is None:
            return None
        log.info("%s could be slower than %s: frames of both are drawn", kind.value, rival.value)
        pool = self._planner.renderers
        other = PlannedCamera(spec, self._planner.plan_by(spec, rival), BudgetMonitor(0.0))
        return _Trial(spec, camera_state, other, planned, is_rival_new=not pool.has_renderer(rival))

    def _take_step(self, trial: _Trial) -> None:
        begin_s = self._clock()
        try:
            self._draw(trial.next_plan, trial.camera_state)
        except Exception:
            kind = trial.next_plan.plan.renderer.value
            log_fault(log, "%s failed in a trial, which ends", kind)
            self._planner.preferences.abandon(trial.spec)
            self._end(trial)
            return
        step_s = self._clock() - begin_s
        self._steps_s.append(step_s)
        self._spent_s += step_s
        trial.record_frame(1e3 * step_s)
        if trial.is_finished:
            self._planner.preferences.record_comparison(trial.spec, trial.medians_ms)
            self._end(trial)

    def _end(self, trial: _Trial) -> None:
        """Plan the camera anew if the rival has won; else free the rival."""
        self._trial = None
        kind, reason = self._planner.choose_renderer(trial.spec)
        log.info("%s draws on: %s", kind.value, reason)
        if kind is not trial.own.plan.renderer:
            self._plan_anew(trial.spec)
        elif trial.is_rival_new:
            self._close_views(trial.rival.plan.renderer)
            self._planner.renderers.renew(trial.rival.plan.renderer)
