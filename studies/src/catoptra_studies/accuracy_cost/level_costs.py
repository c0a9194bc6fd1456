"""Cost and error of every accuracy level: timed in turn, bounded, compared with the reference.

An image is compared over the pixels inside the mirror by RMSE, PSNR and SSIM. SSIM as in Wang,
Bovik, Sheikh & Simoncelli 2004, with their constants: an 11 x 11 Gaussian window of 1.5 px,
K1 = 0.01, K2 = 0.03, on luma, here by Rec. 601.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace

import cv2
import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.plan.error_bound import (
    ErrorBound,
    SceneDisplacement,
    add_scene,
    coordinate_errors,
    error_bound,
    scene_error,
)
from catoptra_server.render.renderer import RenderPlan, View
from catoptra_server.world.mirror_mesh import Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import AccuracyLevel, level_robot_ini
from catoptra_studies.accuracy_cost.cost_results import MIN_GAIN, LevelCost, pareto_front
from catoptra_studies.camera_figures.frame_rates import DrawFunction, RenderTiming, time_round_robin
from catoptra_studies.plot_style import Image
from catoptra_studies.study_subject import StudySubject

_PEAK = 255.0
# Keep both quotients of SSIM finite where an image is black or flat.
_C1, _C2 = (0.01 * _PEAK) ** 2, (0.03 * _PEAK) ** 2
_WINDOW_PX, _SIGMA_PX = 11, 1.5
_LUMA = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True, slots=True)
class _ImageError:
    """Difference of images from their references."""

    rmse: float
    """Root mean square in grey levels of 255, all channels alike."""

    psnr_db: float
    """Peak signal-to-noise ratio; inf where no pixel differs."""

    ssim: float
    """Mean structural similarity; 1 where no pixel differs."""


def compute_image_error(pairs: Sequence[tuple[Image, Image]], mask: Bools) -> _ImageError:
    """Error over several images together.

    Args:
        pairs: (image, reference) of equal shapes (h, w, 3).
        mask: (h, w) pixels that count.
    """
    # Squares are averaged before the root, so that four poses count like one large image.
    squares = [np.mean(np.square(signed_difference(*pair))[mask]) for pair in pairs]
    rmse = math.sqrt(float(np.mean(squares)))
    ssim = float(np.mean([_ssim_map(*pair)[mask].mean() for pair in pairs]))
    psnr_db = 20.0 * math.log10(_PEAK / rmse) if rmse > 0.0 else math.inf
    return _ImageError(rmse, psnr_db, ssim)


def signed_difference(image: Image, reference: Image) -> Floats:
    """(h, w, 3) differences in grey levels, positive where the image is brighter."""
    return image.astype(np.float64) - reference


def _ssim_map(image: Image, reference: Image) -> Floats:
    """(h, w) structural similarity around each pixel."""
    # SSIM is defined for one channel.
    x, y = image @ _LUMA, reference @ _LUMA
    mean_x, mean_y = _blur(x), _blur(y)
    variance_x = _blur(x * x) - mean_x**2
    variance_y = _blur(y * y) - mean_y**2
    covariance = _blur(x * y) - mean_x * mean_y
    luminance = (2.0 * mean_x * mean_y + _C1) / (mean_x**2 + mean_y**2 + _C1)
    structure = (2.0 * covariance + _C2) / (variance_x + variance_y + _C2)
    similarity: Floats = luminance * structure
    return similarity


def _blur(values: Floats) -> Floats:
    size = (_WINDOW_PX, _WINDOW_PX)
    # Reflected borders, as the window has to be full in every pixel of the image.
    blurred: Floats = cv2.GaussianBlur(values, size, _SIGMA_PX, borderType=cv2.BORDER_REFLECT_101)
    return blurred


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
    with ExitStack() as stack:
        # All views are open together, since the levels are timed in turn.
        views = [
            stack.enter_context(
                closing(subject.prepare_view(level.renderer_kind, level.render_settings))
            )
            for level in levels
        ]
        draw = [_draw_function(view, subject) for view in views]
        timings = time_round_robin(draw, num_rounds=num_rounds, on_round=on_round)
        # Pixels with the mirror at their centre; all others are black in every image.
        centres = pixel_sample_positions(subject.camera)[:, :, 0]
        _, mask = direction_from_pixel(subject.camera, centres)
        measured = [
            _measure_level(subject, level, view, reference, timing=timing, mask=mask)
            for level, view, timing in zip(levels, views, timings, strict=True)
        ]
    return _mark_pareto_front(measured)


def _draw_function(view: View, subject: StudySubject) -> DrawFunction:
    states = subject.camera_states
    # Another pose in every round: a frame that repeats the last one finds all data in caches.
    return lambda round_number: view.render(states[round_number % len(states)]).stage_ms


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
    cost = LevelCost(
        name=level.name,
        renderer=level.renderer_kind.value,
        num_polygons=plan.surface.num_polygons if isinstance(plan.surface, Tessellation) else 0,
        samples=plan.samples,
        face_size_px=plan.face_size_px,
        is_key=level.is_key,
        robot_ini=level_robot_ini(level, subject.camera.width_px),
        **asdict(timing),
        bound_max_px=bound.max_px,
        bound_rms_px=bound.rms_px,
        bound_max_deg=bound.max_deg,
        **asdict(error),
        # Decided by `_mark_pareto_front`, once all levels are measured.
        is_on_pareto_front=False,
    )
    return MeasuredLevel(cost, frames[0])


def _bound_frames(subject: StudySubject, plan: RenderPlan) -> ErrorBound:
    """Bound that holds at all poses of a subject."""
    summarizer = SceneSummarizer(subject.scene, subject.world)
    errors = coordinate_errors(plan.renderer, is_large=subject.scene.is_large)
    angle_rad = max(
        summarizer.max_rounding_angle_rad(state, errors) for state in subject.camera_states
    )
    nearest_m = min(
        summarizer.min_distance_m(state, has_ego_body=False) for state in subject.camera_states
    )
    scene = SceneDisplacement(angle_rad, nearest_m)
    return add_scene(
        error_bound(subject.camera, plan), scene_error(subject.camera, plan.renderer, scene)
    )


def _mark_pareto_front(levels: Sequence[MeasuredLevel]) -> tuple[MeasuredLevel, ...]:
    """Mark the levels that no other beats in time and RMSE at once."""
    points = [(level.cost.wall_ms, level.cost.rmse) for level in levels]
    front = pareto_front(points, min_gain=MIN_GAIN)
    return tuple(
        replace(level, cost=replace(level.cost, is_on_pareto_front=index in front))
        for index, level in enumerate(levels)
    )
