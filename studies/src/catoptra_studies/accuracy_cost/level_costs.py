"""Cost and error of every accuracy level: timed in turn, bounded, compared with the reference."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.optics.pixel_grid import pixel_sample_positions
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.planning.error_bound import ErrorBound, GeometricError, add_scene, error_bound
from catoptra_server.planning.rounding_error import coordinate_errors
from catoptra_server.render.render_plan import RenderPlan
from catoptra_server.render.renderer import View
from catoptra_server.scene.mirror_mesh import Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel, level_robot_ini
from catoptra_studies.accuracy_cost.cost_results import LevelCost
from catoptra_studies.accuracy_cost.image_error import ImageError, compute_image_error
from catoptra_studies.accuracy_cost.pareto import MIN_GAIN, pareto_front
from catoptra_studies.camera_figures.frame_rates import (
    DrawFunction,
    RenderTiming,
    time_round_robin,
)
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import StudySubject


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredLevel:
    """An accuracy level after measuring."""

    cost: LevelCost

    frame: Image
    """Frame at the first pose, for the plots."""


def measure_levels(
    subject: StudySubject,
    levels: Sequence[AccuracyLevel],
    reference: Sequence[Image],
    *,
    num_rounds: int,
    on_round: Callable[[], None],
) -> tuple[MeasuredLevel, ...]:
    """Measure time, error bound and image error of each level.

    Args:
        subject: Camera and renderers.
        levels: Levels to measure, all by renderers of the subject.
        reference: Exact frame at each of the subject's poses.
        num_rounds: Timed frames of each level.
        on_round: Called after each round over all levels.
    """
    # All views are open together, since the levels are timed in turn.
    views = [subject.prepare_view(level.renderer_kind, level.render_settings) for level in levels]
    try:
        timings = time_round_robin(
            [_draw_function(view, subject) for view in views],
            num_rounds=num_rounds,
            on_round=on_round,
        )
        mask = _visible_mask(subject.camera)
        measured = [
            _measure_level(subject, level, view, reference, timing=timing, mask=mask)
            for level, view, timing in zip(levels, views, timings, strict=True)
        ]
    finally:
        for view in views:
            view.close()
    return _mark_pareto_front(measured)


def _draw_function(view: View, subject: StudySubject) -> DrawFunction:
    states = subject.camera_states
    # Another pose in every round: a frame that repeats the last one finds its data in caches.
    return lambda round_number: view.render(states[round_number % len(states)]).stage_ms


def _visible_mask(camera: OmniCamera) -> Bools:
    """(h, w) pixels whose centres show the mirror; all others are black in every image."""
    _, is_visible = direction_from_pixel(camera, pixel_sample_positions(camera)[:, :, 0])
    return is_visible


def _measure_level(
    subject: StudySubject,
    level: AccuracyLevel,
    view: View,
    reference: Sequence[Image],
    *,
    timing: RenderTiming,
    mask: Bools,
) -> MeasuredLevel:
    # Rendered again: 32 rounds of 57 levels at 360 px would be 0.7 GB of frames.
    frames = [view.render(state).rgb for state in subject.camera_states]
    error = compute_image_error(list(zip(frames, reference, strict=True)), mask)
    plan = subject.plan(level.renderer_kind, level.render_settings)
    # The geometric part alone: samples blur edges but displace nothing.
    bound = _bound_frames(subject, plan).geometric
    cost = _level_cost(subject.camera, level, plan, bound=bound, timing=timing, error=error)
    return MeasuredLevel(cost, frames[0])


def _bound_frames(subject: StudySubject, plan: RenderPlan) -> ErrorBound:
    """Bound that holds at all poses of a subject."""
    summarizer = SceneSummarizer(subject.scene, subject.world)
    errors = coordinate_errors(subject.camera, plan)
    angle_rad = max(
        summarizer.max_rounding_angle_rad(state, errors) for state in subject.camera_states
    )
    return add_scene(error_bound(subject.camera, plan), subject.camera, angle_rad)


def _level_cost(
    camera: OmniCamera,
    level: AccuracyLevel,
    plan: RenderPlan,
    *,
    bound: GeometricError,
    timing: RenderTiming,
    error: ImageError,
) -> LevelCost:
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
        # Decided by `_mark_pareto_front`, once all levels are measured.
        is_on_pareto_front=False,
    )


def _mark_pareto_front(levels: Sequence[MeasuredLevel]) -> tuple[MeasuredLevel, ...]:
    """Mark the levels that no other beats in time and RMSE at once."""
    points = [(level.cost.wall_ms, level.cost.rmse) for level in levels]
    front = pareto_front(points, min_gain=MIN_GAIN)
    return tuple(
        replace(level, cost=replace(level.cost, is_on_pareto_front=index in front))
        for index, level in enumerate(levels)
    )
