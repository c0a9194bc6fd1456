"""Every step of the ladder: timed in turns, bounded, and held against the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_sample_positions,
)
from catoptra_server.planning.error_bound import error_bound
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import Image, View
from catoptra_server.scene.mirror_mesh import Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel, level_robot_ini
from catoptra_studies.accuracy_cost.cost_results import LevelCost
from catoptra_studies.accuracy_cost.image_error import ImageError, compute_image_error
from catoptra_studies.accuracy_cost.pareto import MIN_GAIN, pareto_front
from catoptra_studies.accuracy_cost.render_timing import (
    DrawFunction,
    RenderTiming,
    time_round_robin,
)
from catoptra_studies.study_subject import StudySubject


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredLevel:
    """A step's cost and its first frame, for the pictures."""

    cost: LevelCost
    frame: Image


def measure_levels(
    subject: StudySubject,
    levels: Sequence[AccuracyLevel],
    reference: Sequence[Image],
    *,
    num_rounds: int,
    on_round: Callable[[], None],
) -> tuple[MeasuredLevel, ...]:
    """Return what each step costs and shows; `reference` holds a frame for each exposure."""
    views = [subject.prepare_view(step) for step in levels]
    try:
        took = time_round_robin(
            [_draw_function(view, subject) for view in views],
            num_rounds=num_rounds,
            on_round=on_round,
        )
        seen = _visible_mask(subject)
        drawn = [
            _measure_level(subject, step, view, reference, timing=time, mask=seen)
            for step, view, time in zip(levels, views, took, strict=True)
        ]
    finally:
        for view in views:
            view.close()
    return _mark_pareto_front(drawn)


def _draw_function(view: View, subject: StudySubject) -> DrawFunction:
    exposures = subject.camera_states
    return lambda number: view.render(exposures[number % len(exposures)]).stage_ms


def _visible_mask(subject: StudySubject) -> Bools:
    """Return the (h, w) pixels whose middles the mirror covers: outside nothing can be wrong."""
    _, seen = direction_from_pixel(subject.camera, pixel_sample_positions(subject.camera)[:, :, 0])
    return seen


def _measure_level(
    subject: StudySubject,
    level: AccuracyLevel,
    view: View,
    reference: Sequence[Image],
    *,
    timing: RenderTiming,
    mask: Bools,
) -> MeasuredLevel:
    frames = [view.render(exposure).rgb for exposure in subject.camera_states]
    error = compute_image_error(list(zip(frames, reference, strict=True)), mask)
    cost = _level_cost(subject.camera, level, subject.plan_level(level), timing=timing, error=error)
    return MeasuredLevel(cost, frames[0])


def _level_cost(
    camera: OmniCamera,
    level: AccuracyLevel,
    plan: RenderPlan,
    *,
    timing: RenderTiming,
    error: ImageError,
) -> LevelCost:
    bound = error_bound(camera, plan).geometric
    return LevelCost(
        name=level.name,
        renderer=level.renderer_kind.value,
        num_polygons=plan.surface.num_polygons if isinstance(plan.surface, Tessellation) else 0,
        samples=plan.samples,
        face_size_px=plan.face_size_px,
        is_key=level.is_key,
        robot_ini=level_robot_ini(level, camera.width_px),
        wall_ms=timing.wall_ms,
        cpu_ms=timing.cpu_ms,
        stage_ms=timing.stage_ms,
        bound_max_px=bound.max_px,
        bound_rms_px=bound.rms_px,
        bound_max_deg=bound.max_deg,
        rmse=error.rmse,
        psnr_db=error.psnr_db,
        ssim=error.ssim,
        is_on_pareto_front=False,
    )


def _mark_pareto_front(levels: Sequence[MeasuredLevel]) -> tuple[MeasuredLevel, ...]:
    """Mark the steps that no other beats in time and image error at once."""
    front = pareto_front([(one.cost.wall_ms, one.cost.rmse) for one in levels], min_gain=MIN_GAIN)
    return tuple(
        replace(one, cost=replace(one.cost, is_on_pareto_front=index in front))
        for index, one in enumerate(levels)
    )
