"""Plans of the cameras that are rendered: chosen at the first frame, and again by measured times.

Belongs to the thread of the renderers; published error bounds may be read by any thread.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import cast

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.frames.planned_camera import PlannedCamera
from catoptra_server.lru_dict import LruDict
from catoptra_server.planning.budget_monitor import BudgetMonitor, BudgetStatus
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.planning.error_bound import ErrorBound
from catoptra_server.planning.perspective_plan import plan_perspective_view
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.planning.render_planner import RenderPlanner

log = logging.getLogger(__name__)

# Cameras of all robots, by zoom and accuracy target; a plan is some 20 kB.
_MAX_CAMERAS = 256
# Costs are measured here where no start poses are given.
DEFAULT_CALIBRATION_STATES = (CameraState(Pose.identity()),)


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """Plan of a camera and the measured cost."""

    choice: PlanChoice
    median_ms: float | None
    """Median time of the last frames; None before 30 frames."""


@dataclass(slots=True)
class ErrorBoundTable:
    """Error bounds of the planned cameras; any thread may read them."""

    # Without a lock: one writer, and single operations of a dict are atomic.
    _bounds: dict[CameraSpec, ErrorBound | None] = field(default_factory=dict)

    def get(self, camera: CameraSpec) -> ErrorBound | None:
        """Error bound of a camera's frames; None before the first one, or without a bound."""
        return self._bounds.get(camera)

    def put(self, camera: CameraSpec, bound: ErrorBound | None) -> None:
        """Publish the bound of a camera."""
        self._bounds[camera] = bound

    def remove(self, camera: CameraSpec) -> None:
        """Remove the bound of a camera."""
        self._bounds.pop(camera, None)


class CameraPlans:
    """Cameras with their plans; the ones used longest ago are forgotten."""

    def __init__(
        self,
        planner: RenderPlanner,
        *,
        calibration_states: Sequence[CameraState] = DEFAULT_CALIBRATION_STATES,
        error_bounds: ErrorBoundTable | None = None,
    ) -> None:
        """Create no plan yet; for the arguments see `ViewCache`."""
        self._planner = planner
        self._calibration_states = calibration_states
        self._error_bounds = error_bounds or ErrorBoundTable()
        self._cameras: LruDict[CameraSpec, PlannedCamera] = LruDict(
            _MAX_CAMERAS, on_remove=self._error_bounds.remove
        )

    def find(self, camera: CameraSpec) -> PlannedCamera:
        """Camera with its plan, chosen at the first call.

        Raises:
            CatoptraError: No plan suits the camera.
        """
        return self._cameras.get_or_make(camera, lambda: self._plan(camera))

    def find_state(self, camera: OmniCameraSpec) -> ViewState:
        """Plan that the next frame of a camera will have; prepares no view."""
        planned = self._cameras.get(camera)
        if planned is None or planned.choice is None:
            # Not kept: clients that try budgets would push out the cameras that are rendered.
            return ViewState(self._planner.choose_plan(camera, self._calibration_states), None)
        choice = self._planner.update_times(camera, planned.choice)
        return ViewState(choice, planned.budget_monitor.median_ms)

    def bound_frame(self, planned: PlannedCamera, scene_angle_rad: float) -> None:
        """Bound the next frame of a camera, and publish the bound where it changed.

        Args:
            scene_angle_rad: Largest displacement by the scene's coordinates.
        """
        if planned.bound_frame(scene_angle_rad) and planned.choice is not None:
            self._error_bounds.put(planned.spec, planned.choice.bound)

    def publish_bound(self, camera: CameraSpec, choice: PlanChoice | None) -> None:
        """Publish the bound of a camera whose last frame another one's plan drew."""
        # Planned, so that its bound is removed with its plan.
        if choice is not None and self.find(camera).choice is not None:
            self._error_bounds.put(camera, choice.bound)

    def record_frame(
        self, planned: PlannedCamera, ms: float, stage_ms: Mapping[str, float]
    ) -> None:
        """Compare the time of a frame with the budget and with the predicted cost.

        Args:
            planned: An omnidirectional camera.
            ms: Wall time of the frame.
            stage_ms: Part of each stage.
        """
        camera = cast(OmniCameraSpec, planned.spec)
        choice, monitor = planned.choice, planned.budget_monitor
        assert choice is not None, "the plan of an omnidirectional camera is a choice"
        better = choice.more_accurate
        better_ms = self._planner.predict_frame_ms(camera, better.plan) if better else None
        # Without an accuracy target, as most cameras are, nothing is predicted.
        is_predicted = choice.predicted_ms is not None
        added_ms = self._planner.added_ms(camera, choice.plan, stage_ms) if is_predicted else 0.0
        status = monitor.record_frame(ms, better_plan_ms=better_ms, added_ms=added_ms)
        # Nothing faster was found before: planning again would not find it either.
        is_settled = status is BudgetStatus.OVER_BUDGET and planned.budget_unreachable
        planned.budget_status = BudgetStatus.WITHIN_BUDGET if is_settled else status
        median_ms = monitor.median_ms if is_predicted else None
        if median_ms is not None:
            added_ms = monitor.median_added_ms
            self._planner.update_correction(camera, choice.plan, median_ms, added_ms)

    def replan_if_due(self, planned: PlannedCamera) -> None:
        """Choose the plan of an omnidirectional camera anew where the budget demands another."""
        if planned.budget_status is BudgetStatus.WITHIN_BUDGET:
            return
        camera = cast(OmniCameraSpec, planned.spec)
        status, planned.budget_status = planned.budget_status, BudgetStatus.WITHIN_BUDGET
        is_over = status is BudgetStatus.OVER_BUDGET
        log.info(
            "%.1f ms a frame (median), budget %g ms: %s",
            planned.budget_monitor.median_ms,
            camera.render_settings.accuracy_target.budget_ms,
            "too slow" if is_over else "headroom",
        )
        choice = self._choose_plan(camera)
        planned.budget_monitor.reset(status)
        # The reason quotes predicted milliseconds, which differ each time.
        is_same = planned.plan == replace(choice.plan, reason=planned.plan.reason)
        planned.budget_unreachable = is_same and is_over
        if is_same:
            log.info("no better plan: %s", choice)
        planned.set_choice(choice)

    def forget_all(self) -> None:
        """Have all cameras planned anew."""
        self._cameras.clear()

    def _plan(self, camera: CameraSpec) -> PlannedCamera:
        if isinstance(camera, OmniCameraSpec):
            choice = self._choose_plan(camera)
            monitor = BudgetMonitor(camera.render_settings.accuracy_target.budget_ms)
            return PlannedCamera(camera, choice.plan, monitor, choice)
        pool = self._planner.renderers
        reason = f"{pool.reason}; {pool.describe(pool.default_kind)}"
        plan = plan_perspective_view(0, kind=pool.default_kind, reason=reason)
        return PlannedCamera(camera, plan, BudgetMonitor(0.0))

    def _choose_plan(self, spec: OmniCameraSpec) -> PlanChoice:
        """Choose the plan of a camera, log it and publish the bound."""
        choice = self._planner.choose_plan(spec, self._calibration_states)
        camera = spec.camera
        log.info("plan of %d x %d px: %s", camera.width_px, camera.height_px, choice)
        log.info("error bound: %s", choice.bound or "none")
        self._error_bounds.put(spec, choice.bound)
        return choice
