"""Plans for the cameras of one scene, with the measured costs of their frames.

Without an accuracy target a plan follows explicit numbers, by the renderer that the server chose.
With a target its renderers are measured once for the camera, and the rates are stored on disk;
times of drawn frames then correct the predictions by one factor a renderer and a time of the
camera's effects. When to choose anew is decided by `frame_plan.py`. Belongs to the thread of the
renderers.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.frames.plan.camera import OmniCameraSpec, describe_viewpoint
from catoptra_server.frames.plan.candidates import (
    CandidateTable,
    MeasureCosts,
    RendererCalibration,
    measure_costs,
)
from catoptra_server.frames.plan.costs import CostCache, CostCorrections, CostModel, added_ms
from catoptra_server.frames.plan.plans import (
    PlanChoice,
    PlanOption,
    choose_by_settings,
    choose_plan,
    pareto_front,
)
from catoptra_server.frames.renderers import RendererPool
from catoptra_server.render.render_settings import MirrorSurface
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import LruDict
from catoptra_server.world.camera_state import CameraState

log = logging.getLogger(__name__)


# Cameras by zoom and tile; a table of 130 candidates holds half a megabyte.
_MAX_CAMERAS = 16


class RenderPlanner:
    """Plans for the cameras of a scene, with the measured costs of their frames."""

    def __init__(
        self,
        renderers: RendererPool,
        cache: CostCache | None = None,
        *,
        measure: MeasureCosts = measure_costs,
    ) -> None:
        """Create a planner that has measured nothing.

        Args:
            renderers: Renderers that plans may choose.
            cache: Costs that earlier servers measured; None measures anew.
            measure: Measures the calibration plans of a renderer.
        """
        self.renderers = renderers
        self._calibration = RendererCalibration(renderers, cache, measure)
        self._tables: LruDict[_CostKey, CandidateTable] = LruDict(_MAX_CAMERAS)
        self._corrections = CostCorrections()

    def choose_plan(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> PlanChoice:
        """Choose the plan of a camera; the reason names the renderer, with engine and device.

        Args:
            camera_states: States to measure costs from, for a camera with an accuracy target.
        """
        choice = self._choose_plan(camera, camera_states)
        device = self.renderers.describe(choice.plan.renderer)
        notes = [choice.plan.reason, describe_viewpoint(camera), device]
        reason = "; ".join(note for note in notes if note)
        return replace(choice, plan=replace(choice.plan, reason=reason))

    def _choose_plan(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> PlanChoice:
        target = camera.render_settings.accuracy_target
        if not target.is_set:
            return self._follow_settings(camera)
        # Bounds and costs of the candidates are the same for all targets: the first plan of a
        # camera takes 0.1 s and more, every other one a millisecond.
        table = self._tables.get_or_make(
            _cost_key(camera), lambda: self._make_table(camera, camera_states)
        )
        if not table.options:
            choice = self._follow_settings(camera)
            reason = f"no target can be met: this mirror's error has no bound; {choice.plan.reason}"
            return PlanChoice(replace(choice.plan, reason=reason), None, target_met=False)
        correct = self._corrections.correct
        # Corrected by drawn frames.
        corrected = (
            replace(one, predicted_ms=correct(camera, one.plan.renderer, one.predicted_ms))
            for one in table.options
        )
        choice = choose_plan(camera.camera, pareto_front(corrected), target)
        note = self.renderers.replacement_note
        if note:
            plan = replace(choice.plan, reason=f"{choice.plan.reason}; {note}")
            choice = replace(choice, plan=plan)
        return choice

    def _follow_settings(self, camera: OmniCameraSpec) -> PlanChoice:
        """Plan by explicit numbers, with a bound where the error has one."""
        pool, requested = self.renderers, camera.render_settings.renderer
        kind, reason = pool.default_kind, pool.reason
        if requested and pool.is_usable(RendererKind(requested)):
            kind, reason = RendererKind(requested), "as requested"
        others = [one for one in RendererKind if pool.is_usable(one)]
        return choose_by_settings(camera, kind, reason, usable=others)

    def predict_frame_ms(self, camera: OmniCameraSpec, plan: RenderPlan) -> float | None:
        """Predicted milliseconds of a plan's frames, corrected; None without measured costs."""
        model = self._find_model(camera)
        if model is None:
            return None
        return self._corrections.correct(camera, plan.renderer, model.predict_frame_ms(plan))

    def update_times(self, camera: OmniCameraSpec, choice: PlanChoice) -> PlanChoice:
        """Choice with times of plan and neighbours as predicted now."""
        if choice.predicted_ms is None:
            return choice
        more_accurate, faster = (
            option and self._update_option(camera, option)
            for option in (choice.more_accurate, choice.faster)
        )
        ms = self.predict_frame_ms(camera, choice.plan)
        return replace(choice, predicted_ms=ms, more_accurate=more_accurate, faster=faster)

    def _update_option(self, camera: OmniCameraSpec, option: PlanOption) -> PlanOption:
        ms = self.predict_frame_ms(camera, option.plan)
        return option if ms is None else replace(option, predicted_ms=ms)

    def added_ms(
        self, camera: OmniCameraSpec, plan: RenderPlan, stage_ms: Mapping[str, float]
    ) -> float:
        """Milliseconds of a frame's stages that the cost model has not, such as effects."""
        model = self._find_model(camera)
        return 0.0 if model is None else added_ms(stage_ms, model.predict_stage_ms(plan))

    def update_correction(
        self, camera: OmniCameraSpec, plan: RenderPlan, median_ms: float, added_ms: float = 0.0
    ) -> None:
        """Update the corrections by medians of drawn frames.

        Args:
            median_ms: Median time of the frames.
            added_ms: Median time of their stages that the cost model has not.
        """
        model = self._find_model(camera)
        if model is not None:
            self._corrections.update(
                camera,
                plan.renderer,
                model.predict_frame_ms(plan),
                median_ms=median_ms,
                added_ms=added_ms,
            )

    def _find_model(self, camera: OmniCameraSpec) -> CostModel | None:
        """Cost model of a camera; None without measured costs."""
        table = self._tables.get(_cost_key(camera))
        return table.model if table is not None and table.options else None

    def discard_tables(self) -> None:
        """Plan all cameras anew: the renderers have changed."""
        self._tables.clear()
        self._corrections.clear()

    def _make_table(
        self, camera: OmniCameraSpec, camera_states: Sequence[CameraState]
    ) -> CandidateTable:
        """Measure the renderers of a camera, and bound all candidates."""
        if self._follow_settings(camera).bound is None:
            return CandidateTable(CostModel(camera.camera, {}), ())
        return self._calibration.make_table(camera, camera_states)

    def close(self) -> None:
        """Close all renderers."""
        self.renderers.close()


_CostKey = tuple[OmniCamera, MirrorSurface, str]


def _cost_key(camera: OmniCameraSpec) -> _CostKey:
    """Everything of a camera that rates and candidates depend on."""
    settings = camera.render_settings
    return camera.camera, settings.surface, settings.renderer
