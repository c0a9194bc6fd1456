"""The study of accuracy against cost: renderers measured here, robots driven through servers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_studies.accuracy_cost.accuracy_levels import (
    AccuracyLevel,
    accuracy_sweep,
    quick_accuracy_sweep,
)
from catoptra_studies.accuracy_cost.cost_results import CostResults, StudyConditions
from catoptra_studies.accuracy_cost.frame_plots import write_frame_plots
from catoptra_studies.accuracy_cost.level_costs import measure_levels
from catoptra_studies.accuracy_cost.polygon_table import measure_polygon_rows
from catoptra_studies.camera_figures.frame_rates import (
    NUM_WARM_UP_ROUNDS,
    FrameRate,
    measure_frame_rates,
)
from catoptra_studies.progress_display import ProgressDisplay
from catoptra_studies.study_subject import (
    REFERENCE_SAMPLES,
    StudySubject,
    open_study_subject,
)


@dataclass(frozen=True, slots=True)
class CostStudyConfig:
    """Extent of the study."""

    robot_file: Path

    world_files: tuple[Path, ...]
    """Worlds for the frame rates; all else is measured in the first."""

    size_px: int
    """Width and height of the image."""

    is_quick: bool
    """Whether to measure within a minute, at the price of noise."""

    output_folder: Path
    date: str
    machine: str

    num_runs: int = 10
    """Drives for each key level."""

    seed: int = 0

    @property
    def num_rounds(self) -> int:
        """Timed frames of each level."""
        # With 32 frames medians repeat to about MIN_GAIN of pareto.py.
        return 6 if self.is_quick else 32

    @property
    def num_poses(self) -> int:
        """Poses at which images are compared."""
        return 2 if self.is_quick else 4

    @property
    def reference_samples(self) -> int:
        """Samples along a pixel's side of the reference."""
        return 8 if self.is_quick else REFERENCE_SAMPLES


def measure_rendering(config: CostStudyConfig, progress: ProgressDisplay) -> CostResults:
    """Measure levels, tessellations and frame rates, and write the plots that show frames.

    The localization of the results is None: `localization_study` measures it with their levels.
    """
    with open_study_subject(
        config.robot_file, config.world_files[0], size_px=config.size_px, num_poses=config.num_poses
    ) as subject:
        levels = _available_levels(subject, config)
        reference = subject.render_reference(config.reference_samples)
        on_round = _add_rounds(progress, "levels: rounds", config.num_rounds)
        measured = measure_levels(
            subject, levels, reference, num_rounds=config.num_rounds, on_round=on_round
        )
        # Before the subject closes: these plots render frames of their own.
        write_frame_plots(subject, measured, reference[0], config.output_folder)
        conditions = _study_conditions(config, subject)
        polygon_rows = measure_polygon_rows(subject.camera)
    return CostResults(
        conditions=conditions,
        levels=tuple(level.cost for level in measured),
        polygon_rows=polygon_rows,
        frame_rates=tuple(
            row
            for file in config.world_files
            for row in _measure_world_frame_rates(config, file, progress)
        ),
    )


def _available_levels(subject: StudySubject, config: CostStudyConfig) -> list[AccuracyLevel]:
    """Levels of the renderers that run here: only those of trace without OpenGL."""
    # A plan is arithmetic and needs no renderer, so raster's exists without OpenGL, too.
    face_size_px = subject.plan(RendererKind.RASTER, RenderSettings()).face_size_px
    sweep = quick_accuracy_sweep if config.is_quick else accuracy_sweep
    return [level for level in sweep(face_size_px) if level.renderer_kind in subject.renderers]


def _measure_world_frame_rates(
    config: CostStudyConfig, world_file: Path, progress: ProgressDisplay
) -> list[FrameRate]:
    """Measure the frame rates in one world with each renderer."""
    # The first world is opened again: the views of its levels are closed, and only those of the
    # payloads are in memory.
    description, _ = read_robot(config.robot_file)
    rows: list[FrameRate] = []
    with open_study_subject(
        config.robot_file, world_file, size_px=config.size_px, num_poses=config.num_poses
    ) as subject:
        for kind in subject.renderers:
            # Payloads differ by less than levels do, so their medians take twice the frames.
            num_rounds = 2 * config.num_rounds
            title = f"frame rates: {world_file.stem}, {kind.value}"
            rows += measure_frame_rates(
                subject,
                description.drive,
                kind,
                num_rounds=num_rounds,
                on_round=_add_rounds(progress, title, num_rounds),
            )
    return rows


def _add_rounds(progress: ProgressDisplay, title: str, num_rounds: int) -> Callable[[], None]:
    return progress.add_task(title, NUM_WARM_UP_ROUNDS + num_rounds)


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
