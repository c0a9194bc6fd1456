"""The study itself: what is measured, in which order, with how many frames. Prints nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.progress import Progress

from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.render_plan import RendererKind, RenderSettings
from catoptra_studies.accuracy_cost.accuracy_levels import (
    AccuracyLevel,
    accuracy_sweep,
    quick_accuracy_sweep,
)
from catoptra_studies.accuracy_cost.cost_plots import write_frame_plots
from catoptra_studies.accuracy_cost.cost_results import CostResults, FrameRate, StudyConditions
from catoptra_studies.accuracy_cost.frame_rates import measure_frame_rates
from catoptra_studies.accuracy_cost.level_costs import measure_levels
from catoptra_studies.accuracy_cost.polygon_table import measure_polygon_rows
from catoptra_studies.accuracy_cost.render_timing import NUM_WARM_UP_ROUNDS
from catoptra_studies.study_subject import (
    REFERENCE_SAMPLES,
    StudySubject,
    open_study_subject,
)


@dataclass(frozen=True, slots=True)
class CostStudyConfig:
    """What to measure. worlds: frame rates in all, the rest in the first."""

    robot_file: Path
    world_files: tuple[Path, ...]
    size_px: int
    is_quick: bool
    output_folder: Path
    date: str
    machine: str

    @property
    def num_rounds(self) -> int:
        """Return how many frames of each step are timed."""
        return 6 if self.is_quick else 32

    @property
    def num_poses(self) -> int:
        """Return from how many places pictures are compared."""
        return 2 if self.is_quick else 4

    @property
    def reference_samples(self) -> int:
        """Return the samples of the reference along a pixel's side."""
        return 8 if self.is_quick else REFERENCE_SAMPLES


def run_cost_study(config: CostStudyConfig, progress: Progress) -> CostResults:
    """Return all that was measured; writes the pictures that need frames on the way."""
    with open_study_subject(
        config.robot_file, config.world_files[0], size_px=config.size_px, num_poses=config.num_poses
    ) as subject:
        steps = _available_levels(subject, config)
        reference = subject.render_reference(config.reference_samples)
        on_round = _progress_callback(progress, "ladder: rounds", config.num_rounds)
        drawn = measure_levels(
            subject, steps, reference, num_rounds=config.num_rounds, on_round=on_round
        )
        write_frame_plots(subject, drawn, reference[0], config.output_folder)
        conditions = _study_conditions(config, subject)
        table = measure_polygon_rows(subject.camera)
    return CostResults(
        conditions=conditions,
        levels=tuple(one.cost for one in drawn),
        polygon_rows=table,
        frame_rates=tuple(
            row
            for world in config.world_files
            for row in _world_frame_rates(config, world, progress)
        ),
    )


def _available_levels(subject: StudySubject, config: CostStudyConfig) -> list[AccuracyLevel]:
    """Return the steps that can be drawn here: without OpenGL those of trace alone."""
    own = subject.plan_level(AccuracyLevel("", RendererKind.RASTER, RenderSettings())).face_size_px
    steps = quick_accuracy_sweep(own) if config.is_quick else accuracy_sweep(own)
    return [step for step in steps if step.renderer_kind in subject.renderers]


def _world_frame_rates(config: CostStudyConfig, world: Path, progress: Progress) -> list[FrameRate]:
    """Return the frame rates in a world by each renderer."""
    description, _ = read_robot(config.robot_file)
    rows: list[FrameRate] = []
    with open_study_subject(
        config.robot_file, world, size_px=config.size_px, num_poses=config.num_poses
    ) as subject:
        for kind in subject.renderers:
            name = f"frame rates: {world.stem}, {kind.value}"
            rounds = 2 * config.num_rounds
            rows += measure_frame_rates(
                subject,
                description.drive,
                kind,
                num_rounds=rounds,
                on_round=_progress_callback(progress, name, rounds),
            )
    return rows


def _progress_callback(progress: Progress, name: str, num_rounds: int) -> Callable[[], None]:
    task = progress.add_task(name, total=NUM_WARM_UP_ROUNDS + num_rounds)
    return partial(progress.advance, task)


def _study_conditions(config: CostStudyConfig, subject: StudySubject) -> StudyConditions:
    return StudyConditions(
        date=config.date,
        machine=config.machine,
        renderers=tuple(renderer.describe() for renderer in subject.renderers.values()),
        robot=config.robot_file.stem,
        world=subject.world.name,
        size_px=config.size_px,
        is_quick=config.is_quick,
        num_rounds=config.num_rounds,
        num_poses=config.num_poses,
        reference_samples=config.reference_samples,
    )
