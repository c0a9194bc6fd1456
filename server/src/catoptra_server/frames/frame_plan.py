"""Decision about a frame: everything that its drawing follows, frozen before a ray is traced.

`FramePlanner.decide` answers once, with one value, and what draws decides nothing: the camera (with
one viewpoint where the scene is far enough), the plan, the camera's state under its scene effects,
the image effects and the error bound. `FramePlanner.record` takes what the drawn frame showed: the
effects that it measured as invisible, and its time. Nothing here belongs to a renderer: a criterion
that raises fails that frame alone. All of it belongs to the thread of the renderers; published
error bounds may be read by any thread.

* A decision about an effect follows from one exposure. The drawn frame's largest change, not a
  pilot frame, says whether the effect shows.
* In real time what a body, shadows and baked light change is measured twice a second, while each
  changes over eight times its threshold and the camera stays near: to measure it takes a seventh
  of a frame of the laboratory. The picture is the same, and the reason names the earlier frame.
* A budget counts as exceeded when the median of 30 frames is more than a fifth above: the next
  frame is planned anew. Headroom, a more accurate plan predicted to take at most 0.85 of the
  budget, has to last 300 frames, twice as long after each mistake, so that plans do not oscillate.
  The price of a budget: bytes depend on the machine.
* The bound of a frame is the plan's and the share of the scene's coordinates: 8 microseconds
  a frame, 0.2 ms in a new cell of the scene's grid, 0.6 among a million triangles; 3 to 13 ms at
  the first of an eighth of an octave of distances from an approximated viewpoint. A plan is chosen
  with the share of the start poses. Where a frame's exceeds its tolerance the plan stays, and
  `target_met`, the plan's text and the log say so.
"""

from __future__ import annotations

import logging
import math
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from typing import TYPE_CHECKING, cast

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import EffectChange, gains_after, summary_fields
from catoptra_server.effects.bounds.coordinate_rounding import round_down
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import (
    NO_EFFECTS,
    EffectDecision,
    EffectPlan,
    apply_scene_effects,
    describe_changes,
    format_decisions,
    plan_effects,
)
from catoptra_server.frames.plan.camera import (
    CameraSpec,
    OmniCameraSpec,
    choose_viewpoint,
    shows_ego_body,
)
from catoptra_server.frames.plan.error_bound import (
    ErrorBound,
    SceneDisplacement,
    coordinate_errors,
)
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.plan.plans import (
    DEFAULT_SAMPLES,
    PerspectivePlan,
    PlanChoice,
    SceneDisplacements,
    explain_limit,
    explain_raster,
    limit_time_samples,
)
from catoptra_server.render.renderer import RenderedImage, RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import LruDict
from catoptra_server.world.objects import CameraState

if TYPE_CHECKING:
    # Loaded late: see `commands/server.py`.
    from catoptra_server.frames.labels import LabelledImage

log = logging.getLogger(__name__)

# Cameras of all robots, by zoom and accuracy target; a plan is some 20 kB.
_MAX_CAMERAS = 256
# Costs are measured here where no start poses are given.
DEFAULT_CALIBRATION_STATES = (CameraState(Pose.identity()),)

_Plan = RenderPlan | PerspectivePlan
# How long and far from its frame a change holds that is so many times its threshold.
_RECENT_S, _RECENT_M, _RECENT_FACTOR = 0.5, 0.3, 8.0
_HELD_EFFECTS = ("SelfView", "Shadows", "BakedLight")
ViewKey = tuple[OmniCamera | PerspectiveCamera, _Plan]


@dataclass(frozen=True, slots=True, eq=False)
class FramePlan:
    """Everything that is decided about a frame before it is drawn."""

    camera: CameraSpec
    """Camera to draw: the requested one, or that with one viewpoint for all its rays."""
    requested: CameraSpec
    """Camera as the client requested it, whose rays label the picture."""
    plan: _Plan
    view_key: ViewKey
    """Everything that a prepared view depends on; cameras with equal keys share a view."""
    plan_text: str
    """Plan in words."""
    camera_state: CameraState
    """State with all scene effects, its time samples limited by the budget of rays."""
    unlimited_state: CameraState
    """The same before that limit."""
    effects: EffectPlan
    choice: PlanChoice | None
    """Choice of the plan with the frame's bound; None for a perspective camera."""
    bounds: Mapping[str, float] | None
    """Bounds of the image error by name; None for perspective cameras, whose error has no bound."""
    camera_plan: CameraPlan
    """Plan of the camera, which the times of its frames change."""
    decision_ms: float
    """Milliseconds that the decision took, but for the choice of the plan."""

    @property
    def labelled_image(self) -> LabelledImage:
        """The image as its labels see it: by the mirror's own rays, however far its scene is."""
        from catoptra_server.frames.labels import LabelledImage

        return LabelledImage(
            self.requested.camera,
            self.camera_state,
            self.effects.image_effects,
            self.plan.samples,
        )

    def conclude(self, changes: Mapping[str, EffectChange]) -> tuple[EffectDecision, ...]:
        """Decisions about the effects of the drawn frame, in optical order.

        Args:
            changes: Change by effect: `renderer.RenderedImage.changes`.
        """
        decisions = explain_raster(self.effects.decide_by_frame(changes), self.plan)
        if self.camera_state is self.unlimited_state:
            return decisions
        return explain_limit(decisions, self.unlimited_state, self.camera_state)


@dataclass(frozen=True, slots=True, eq=False)
class ViewState:
    """Plan of a camera and the measured cost."""

    choice: PlanChoice
    median_ms: float | None
    """Median time of the last frames; None before 30 frames."""


# Error bounds of the drawn cameras by camera, None for a plan without one; any thread may read
# them. Without a lock: one writer, and single operations of a dict are atomic.
ErrorBoundTable = dict[CameraSpec, ErrorBound | None]


class CameraPlan:
    """Plan that the frames of a camera follow until their times demand another."""

    def __init__(self, camera: CameraSpec, plan: _Plan, choice: PlanChoice | None = None) -> None:
        """Follow a plan.

        Args:
            camera: Camera of the frames.
            plan: Plan to begin with.
            choice: The same plan with its bound; None for a perspective camera.
        """
        self.camera = camera
        self.plan = plan
        self.choice = choice
        """Choice with the bound of the last frame."""
        self.summary_fields = summary_fields(camera.effect_settings)
        self.shadow_gains = gains_after(camera.effect_settings, "Shadows")
        self.decisions: tuple[EffectDecision, ...] = ()
        """Decisions about the effects of the last frame."""
        # A perspective camera has no budget.
        self.monitor = _BudgetMonitor(
            camera.render_settings.accuracy_target.budget_ms
            if isinstance(camera, OmniCameraSpec)
            else 0.0
        )
        self.recent: tuple[float, Pose, Mapping[str, EffectChange]] = (
            -math.inf,
            Pose.identity(),
            {},
        )
        """Time, camera's pose and changes of the last frame that measured these."""
        self.status = _BudgetStatus.WITHIN_BUDGET
        self.is_unreachable = False
        """Whether planning found nothing faster although the budget is exceeded; logged once."""
        self._derive()

    def _derive(self) -> None:
        # Once a plan: every frame looks up the same view, and carries the same text and numbers.
        # The reason quotes targets and predicted times.
        self.view_key: ViewKey = (self.camera.camera, replace(self.plan, reason=""))
        self.plan_text = str(self.plan)
        self.bounds: dict[str, float] | None = None
        self._plan_choice = self.choice  # with the bound of the plan alone
        self._scene: SceneDisplacements | None = None
        self._is_excess_logged = False

    def set_choice(self, choice: PlanChoice) -> None:
        """Replace the plan by a new choice, with the bound of the plan alone."""
        self.plan, self.choice = choice.plan, choice
        self._derive()

    def place(self, scene: SceneDisplacements) -> PlanChoice | None:
        """Choice with the bounds of a frame at a place; None for a perspective camera."""
        if self._plan_choice is None or scene == self._scene:
            return self.choice
        return self._plan_choice.place(cast(OmniCamera, self.camera.camera), scene)

    def hold_changes(self, effects: EffectPlan, state: CameraState, now_s: float) -> EffectPlan:
        """The effects without measuring what a frame shortly before showed to change much."""
        at_s, pose, changes = self.recent
        held = {
            name: replace(one, is_known=True)
            for name, one in effects.thresholds.items()
            if name in _HELD_EFFECTS and one.is_measured
        }
        is_near = (
            now_s - at_s <= _RECENT_S
            # What moves is blurred by the frame's own measures.
            and state.shutter is None
            and math.dist(state.world_from_mirror.translation, pose.translation) <= _RECENT_M
        )
        if not is_near or any(
            name not in changes or changes[name].largest <= _RECENT_FACTOR * one.max_change
            for name, one in held.items()
        ):
            return effects
        return replace(effects, thresholds={**effects.thresholds, **held})

    def add_held(
        self,
        effects: EffectPlan,
        state: CameraState,
        changes: Mapping[str, EffectChange],
        now_s: float,
    ) -> Mapping[str, EffectChange]:
        """Changes that a frame measured, with those that are held."""
        held = [name for name, one in effects.thresholds.items() if one.is_known]
        if held:
            return {**changes, **{name: self.recent[2][name] for name in held}}
        earlier = {name: replace(one, is_earlier=True) for name, one in changes.items()}
        self.recent = now_s, state.world_from_mirror, earlier
        return changes

    def bound_frame(self, scene: SceneDisplacements) -> None:
        """Add to the plan's bound what a frame's scene contributes."""
        choice = self.place(scene)
        if choice is None or choice.bound is None or choice is self.choice:
            return
        size = f"{self.camera.camera.width_px} x {self.camera.camera.height_px} px"
        if self._scene is None:
            log.info("error bound of %s: %s", size, choice.bound)
        if choice.excess and not self._is_excess_logged:
            self._is_excess_logged = True
            log.warning("accuracy target of %s: %s", size, choice.excess)
        self._scene, self.choice = scene, choice
        self.bounds, self.plan_text = choice.bound.numbers_by_name(), choice.text


class FramePlanner:
    """Decides about the frames of one scene, and records what the drawn ones show."""

    def __init__(
        self,
        planner: RenderPlanner,
        summarizer: SceneSummarizer,
        *,
        calibration_states: Sequence[CameraState] = DEFAULT_CALIBRATION_STATES,
        error_bounds: ErrorBoundTable | None = None,
        holds_changes: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Create a planner without any camera.

        Args:
            planner: Chooses the plans of cameras.
            summarizer: Summarizes the scene for the decisions about effects.
            calibration_states: Camera states to measure costs from, where an accuracy target
                needs measured costs.
            error_bounds: Table to publish error bounds in.
            holds_changes: Whether a frame may take over what one shortly before has measured.
            clock: Clock in seconds that decisions are timed by.
        """
        self._clock = clock
        self._planner = planner
        self._summarizer = summarizer
        is_large = summarizer.scene.is_large
        self._coordinate_errors = {
            kind: coordinate_errors(kind, is_large=is_large) for kind in RendererKind
        }
        self._calibration_states = calibration_states
        self._error_bounds: ErrorBoundTable = {} if error_bounds is None else error_bounds
        self._holds_changes = holds_changes
        # The ones used longest ago are forgotten.
        self._cameras: LruDict[CameraSpec, CameraPlan] = LruDict(
            _MAX_CAMERAS, on_remove=lambda camera: self._error_bounds.pop(camera, None)
        )

    def decide(self, camera: CameraSpec, camera_state: CameraState) -> FramePlan:
        """Decide everything that a frame of a camera follows.

        Raises:
            CatoptraError: No plan suits the camera.
        """
        drawn = self._choose_viewpoint(camera, camera_state)
        camera_plan = self.plan_camera(drawn)
        # Before a frame, not after: the frame's plan is the one that rendered it.
        self._replan_if_due(camera_plan)
        begin_s = self._clock()
        effects = self._decide_effects(camera_plan, camera_state)
        unlimited = apply_scene_effects(camera_state, effects)
        # A perspective camera turns away from what it measured.
        if self._holds_changes and isinstance(drawn, OmniCameraSpec):
            effects = camera_plan.hold_changes(effects, unlimited, begin_s)
        limited = unlimited
        if unlimited.shutter is not None:
            limited = limit_time_samples(unlimited, drawn.camera, camera_plan.plan)
        if isinstance(drawn, OmniCameraSpec):
            camera_plan.bound_frame(self._find_displacements(drawn.camera, unlimited))
        # Planned, so that its bound is removed with its plan.
        own_plan = camera_plan if drawn is camera else self.plan_camera(camera)
        if camera_plan.choice is not None and own_plan.choice is not None:
            self._error_bounds[camera] = camera_plan.choice.bound
        return FramePlan(
            drawn,
            camera,
            camera_plan.plan,
            camera_plan.view_key,
            camera_plan.plan_text,
            limited,
            unlimited,
            effects,
            camera_plan.choice,
            camera_plan.bounds,
            camera_plan,
            1e3 * (self._clock() - begin_s),
        )

    def plan_camera(self, camera: CameraSpec) -> CameraPlan:
        """Plan of a camera, chosen at the first call.

        Raises:
            CatoptraError: No plan suits the camera.
        """
        return self._cameras.get_or_make(camera, lambda: self._plan_camera(camera))

    def record(
        self, frame_plan: FramePlan, image: RenderedImage, drawing_ms: float
    ) -> tuple[EffectDecision, ...]:
        """Record a drawn frame; the decisions about its effects, with what the frame shows.

        Args:
            frame_plan: Decision that the frame followed.
            image: The frame's image, with its stages.
            drawing_ms: Wall time of the drawing.
        """
        camera_plan = frame_plan.camera_plan
        if frame_plan.choice is not None:
            frame_ms = frame_plan.decision_ms + drawing_ms
            self._record_time(camera_plan, frame_ms, image.stage_ms)
        if not frame_plan.effects.decisions:
            return ()
        effects, state = frame_plan.effects, frame_plan.camera_state
        changes = camera_plan.add_held(effects, state, image.changes, self._clock())
        decisions = frame_plan.conclude(changes)
        # Once whole: bounds move with every pose, and viewers and `explain` show the present ones.
        if not camera_plan.decisions:
            log.info("effects:\n%s", format_decisions(decisions, {}))
        elif changes := describe_changes(camera_plan.decisions, decisions):
            log.info("effects: %s", changes)
        camera_plan.decisions = decisions
        return decisions

    def find_state(self, camera: OmniCameraSpec, camera_state: CameraState) -> ViewState:
        """Plan that a frame of a camera would have; prepares no view."""
        drawn = cast(OmniCameraSpec, self._choose_viewpoint(camera, camera_state))
        # Not kept: clients that try budgets would push out the cameras that are rendered.
        camera_plan = self._cameras.get(drawn) or self._plan_camera(drawn)
        shown = apply_scene_effects(camera_state, self._decide_effects(camera_plan, camera_state))
        choice = camera_plan.place(self._find_displacements(drawn.camera, shown))
        assert choice is not None, "the plan of an omnidirectional camera is a choice"
        choice = self._planner.update_times(drawn, choice)
        return ViewState(choice, camera_plan.monitor.median_ms)

    def forget_all(self) -> None:
        """Have all cameras planned anew, with other renderers."""
        self._cameras.clear()
        self._planner.discard_tables()

    def close(self) -> None:
        """Free all plans, and the renderers."""
        self._cameras.clear()
        self._planner.close()

    def _choose_viewpoint(self, camera: CameraSpec, camera_state: CameraState) -> CameraSpec:
        """Camera of a frame: with one viewpoint where the scene is far enough."""
        if not isinstance(camera, OmniCameraSpec) or not _leaves_choice(camera):
            return camera
        nearest_m = self._summarizer.min_distance_m(
            camera_state, has_ego_body=shows_ego_body(camera)
        )
        return choose_viewpoint(camera, nearest_m)

    def _find_displacements(self, camera: OmniCamera, *states: CameraState) -> SceneDisplacements:
        """Largest displacement in any of some states."""
        find, nearest_m = self._summarizer.max_rounding_angle_rad, math.inf
        if camera.has_mirror and not camera.mirror.is_central:
            # Ego bodies that are shown are among a state's objects.
            distances_m = (
                self._summarizer.min_distance_m(state, has_ego_body=False) for state in states
            )
            nearest_m = min(round_down(distances_m))
        return {
            kind: SceneDisplacement(max(find(state, one) for state in states), nearest_m)
            for kind, one in self._coordinate_errors.items()
        }

    def _decide_effects(self, camera_plan: CameraPlan, camera_state: CameraState) -> EffectPlan:
        """Decide which effects a camera state calls for."""
        camera, settings = camera_plan.camera, camera_plan.camera.effect_settings
        if not settings.settings:
            return NO_EFFECTS
        fields = camera_plan.summary_fields
        gains = camera_plan.shadow_gains
        summary = self._summarizer.summarize(camera_state, camera.camera, fields, gains)
        return plan_effects(settings, summary, camera.camera)

    def _record_time(
        self, camera_plan: CameraPlan, frame_ms: float, stage_ms: Mapping[str, float]
    ) -> None:
        """Compare the time of a frame with the budget and with the predicted cost."""
        camera = cast(OmniCameraSpec, camera_plan.camera)
        choice, monitor = camera_plan.choice, camera_plan.monitor
        assert choice is not None, "the plan of an omnidirectional camera is a choice"
        better = choice.more_accurate
        better_ms = self._planner.predict_frame_ms(camera, better.plan) if better else None
        # Without an accuracy target, as most cameras are, nothing is predicted.
        is_predicted = choice.predicted_ms is not None
        added_ms = self._planner.added_ms(camera, choice.plan, stage_ms) if is_predicted else 0.0
        status = monitor.record_frame(frame_ms, better_plan_ms=better_ms, added_ms=added_ms)
        # Nothing faster was found before: planning again would not find it either.
        is_settled = status is _BudgetStatus.OVER_BUDGET and camera_plan.is_unreachable
        camera_plan.status = _BudgetStatus.WITHIN_BUDGET if is_settled else status
        median_ms = monitor.median_ms if is_predicted else None
        if median_ms is not None:
            added_ms = monitor.median_added_ms
            self._planner.update_correction(camera, choice.plan, median_ms, added_ms)

    def _replan_if_due(self, camera_plan: CameraPlan) -> None:
        """Choose the plan of an omnidirectional camera anew where the budget demands another."""
        if camera_plan.status is _BudgetStatus.WITHIN_BUDGET:
            return
        camera = cast(OmniCameraSpec, camera_plan.camera)
        status, camera_plan.status = camera_plan.status, _BudgetStatus.WITHIN_BUDGET
        is_over = status is _BudgetStatus.OVER_BUDGET
        log.info(
            "%.1f ms a frame (median), budget %g ms: %s",
            camera_plan.monitor.median_ms,
            camera.render_settings.accuracy_target.budget_ms,
            "too slow" if is_over else "headroom",
        )
        choice = self._choose_plan(camera)
        camera_plan.monitor.reset(status)
        # The reason quotes predicted milliseconds, which differ each time.
        is_same = camera_plan.plan == replace(choice.plan, reason=camera_plan.plan.reason)
        camera_plan.is_unreachable = is_same and is_over
        if is_same:
            log.info("no better plan: %s", choice)
        camera_plan.set_choice(choice)

    def _plan_camera(self, camera: CameraSpec) -> CameraPlan:
        if isinstance(camera, OmniCameraSpec):
            choice = self._choose_plan(camera)
            return CameraPlan(camera, choice.plan, choice)
        pool = self._planner.renderers
        reason = f"{pool.reason}; {pool.describe(pool.default_kind)}"
        plan = PerspectivePlan(pool.default_kind, DEFAULT_SAMPLES, reason)
        return CameraPlan(camera, plan)

    def _choose_plan(self, spec: OmniCameraSpec) -> PlanChoice:
        """Choose the plan of a camera for the start poses, and log it."""
        camera, states = spec.camera, self._calibration_states
        # Without a target nothing is weighed.
        scene = None
        if spec.render_settings.accuracy_target.is_set:
            scene = self._find_displacements(camera, *states)
        choice = self._planner.choose_plan(spec, states, scene)
        placed = choice.place(camera, scene) if scene else choice
        log.info("plan of %d x %d px: %s", camera.width_px, camera.height_px, placed)
        return choice


def _leaves_choice(camera: OmniCameraSpec) -> bool:
    """Whether each frame of a camera may be drawn exactly or from one viewpoint.

    Not with a tolerance, which the bound of the approximation, larger than its error, would use up.
    """
    return (
        camera.render_settings.central_error_px > 0.0
        and not camera.render_settings.accuracy_target.max_error_px
        and not camera.camera.is_central
    )


# A second at 30 Hz: long enough for a stable median, short enough to react.
_WINDOW_FRAMES = 30
_OVERRUN_FACTOR = 1.2
_HEADROOM_FRACTION = 0.85
# Frames with headroom before a more accurate plan is tried, and the limit after setbacks: ten
# seconds at 30 Hz, and some five minutes.
_HYSTERESIS_FRAMES = 300
_MAX_HYSTERESIS_FRAMES = 10_000


class _BudgetStatus(Enum):
    """Frame times of a plan in relation to the budget."""

    WITHIN_BUDGET = "within budget"
    OVER_BUDGET = "over budget"
    HEADROOM = "headroom"


class _BudgetMonitor:
    """Frame times of one camera, across all plans of its budget."""

    def __init__(self, budget_ms: float) -> None:
        self._budget_ms = budget_ms
        self._frame_times_ms: deque[float] = deque(maxlen=_WINDOW_FRAMES)
        self._added_ms: deque[float] = deque(maxlen=_WINDOW_FRAMES)
        self._frames_with_headroom = 0
        self._hysteresis_frames = _HYSTERESIS_FRAMES
        self._was_upgraded = False

    @property
    def median_ms(self) -> float | None:
        """Median of the last 30 frames; None before as many."""
        from statistics import median

        is_full = len(self._frame_times_ms) == _WINDOW_FRAMES
        return median(self._frame_times_ms) if is_full else None

    @property
    def median_added_ms(self) -> float:
        """Median of the times in these frames that the cost model has not; 0 before a frame."""
        from statistics import median

        return median(self._added_ms) if self._added_ms else 0.0

    def record_frame(
        self, frame_ms: float, *, better_plan_ms: float | None, added_ms: float = 0.0
    ) -> _BudgetStatus:
        """Record a frame.

        Args:
            frame_ms: Wall time of the frame.
            added_ms: Part of it that the cost model has not, such as effects.
            better_plan_ms: Predicted time of the next more accurate plan, corrected; None without
                one.
        """
        self._frame_times_ms.append(frame_ms)
        self._added_ms.append(added_ms)
        # Most cameras have no budget; the median took 0.02 ms of each of their frames.
        median_ms = self.median_ms if self._budget_ms else None
        if median_ms is None:
            return _BudgetStatus.WITHIN_BUDGET
        # The median, not the mean: a single slow frame, such as a page fault, decides nothing.
        if median_ms > _OVERRUN_FACTOR * self._budget_ms:
            return _BudgetStatus.OVER_BUDGET
        has_headroom = (
            better_plan_ms is not None and better_plan_ms <= _HEADROOM_FRACTION * self._budget_ms
        )
        self._frames_with_headroom = self._frames_with_headroom + 1 if has_headroom else 0
        return (
            _BudgetStatus.HEADROOM
            if self._frames_with_headroom >= self._hysteresis_frames
            else _BudgetStatus.WITHIN_BUDGET
        )

    def reset(self, status: _BudgetStatus) -> None:
        """Start over with another plan, chosen because of a status."""
        # Only an overrun right after an upgrade is a mistake of the upgrade; other overruns come
        # from the scene or from load.
        if status is _BudgetStatus.OVER_BUDGET and self._was_upgraded:
            self._hysteresis_frames = min(2 * self._hysteresis_frames, _MAX_HYSTERESIS_FRAMES)
        self._was_upgraded = status is _BudgetStatus.HEADROOM
        self._frame_times_ms.clear()
        self._added_ms.clear()
        self._frames_with_headroom = 0
