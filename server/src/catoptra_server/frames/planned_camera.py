"""A camera with its plan: everything that frames of the camera share, but for the prepared view."""

from __future__ import annotations

from dataclasses import field, replace
from typing import cast

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.planning.budget_monitor import BudgetMonitor, BudgetStatus
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec
from catoptra_server.planning.error_bound import add_scene
from catoptra_server.planning.perspective_plan import PerspectivePlan
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.render.render_plan import RenderPlan

Plan = RenderPlan | PerspectivePlan
ViewKey = tuple[OmniCamera | PerspectiveCamera, Plan]


@dataclass(slots=True, eq=False)
class PlannedCamera:
    """A camera and the plan that its frames follow."""

    spec: CameraSpec
    plan: Plan
    budget_monitor: BudgetMonitor
    choice: PlanChoice | None = None
    """Choice with the bound of the last frame; None for a perspective camera."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of the last frame."""
    budget_status: BudgetStatus = BudgetStatus.WITHIN_BUDGET
    budget_unreachable: bool = False
    """Whether planning found nothing faster although the budget is exceeded; logged once."""
    view_key: ViewKey = field(init=False)
    """Everything that a view depends on; cameras with equal keys share a view."""
    plan_text: str = field(init=False)
    bounds: dict[str, float] | None = field(init=False, default=None)
    _plan_choice: PlanChoice | None = field(init=False, default=None)
    """Choice with the bound of the plan alone."""
    _scene_angle_rad: float | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        self._derive()

    def _derive(self) -> None:
        # Once a plan: every frame looks up the same view, and carries the same text and numbers.
        # The reason quotes targets and predicted times.
        self.view_key = self.spec.camera, replace(self.plan, reason="")
        self.plan_text = str(self.plan)
        self._plan_choice, self._scene_angle_rad = self.choice, None
        if self.choice is not None and self.choice.bound is not None:
            self.bounds = self.choice.bound.as_dict()

    def set_choice(self, choice: PlanChoice) -> None:
        """Replace the plan by a new choice."""
        self.plan, self.choice = choice.plan, choice
        self._derive()

    def bound_frame(self, scene_angle_rad: float) -> bool:
        """Add to the plan's bound what a frame's scene contributes; whether that changed it.

        Args:
            scene_angle_rad: Largest displacement by the scene's coordinates.
        """
        choice = self._plan_choice
        if choice is None or choice.bound is None or scene_angle_rad == self._scene_angle_rad:
            return False
        self._scene_angle_rad = scene_angle_rad
        spec = cast(OmniCameraSpec, self.spec)
        bound = add_scene(choice.bound, spec.camera, scene_angle_rad)
        tolerance_px = spec.render_settings.accuracy_target.max_error_px
        is_exceeded = 0.0 < tolerance_px < bound.outline_error_px
        self.choice = replace(choice, bound=bound, target_met=choice.target_met and not is_exceeded)
        self.bounds = bound.as_dict()
        return True
