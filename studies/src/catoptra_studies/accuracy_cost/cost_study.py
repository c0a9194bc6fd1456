"""The study of accuracy against cost: levels, mirror meshes and frame rates, measured here.

Localization with frames of the levels is another part (`localization_study`). The displacement by
meshes is measured at the paper's size and compared with an independent table: derived in float64
and confirmed by OpenGL in float32, for the paper's mirror (k = 11.546, rim at 120 degrees) in
360 x 360 px, rms and maximum over the covered pixel centres.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from catoptra_protocol.optics.mirrors import PAPER_MIRROR, HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import (
    SQUARE_TESSELLATIONS,
    WIDE_TESSELLATIONS,
    AccuracyLevel,
    accuracy_sweep,
    quick_accuracy_sweep,
)
from catoptra_studies.accuracy_cost.cost_results import CostResults, PolygonRow, StudyConditions
from catoptra_studies.accuracy_cost.frame_plots import write_frame_plots
from catoptra_studies.accuracy_cost.level_costs import measure_levels
from catoptra_studies.camera_figures.frame_rates import (
    NUM_WARM_UP_ROUNDS,
    FrameRate,
    measure_frame_rates,
)
from catoptra_studies.camera_figures.polygon_figures import measure_polygon_error
from catoptra_studies.commands import ProgressDisplay
from catoptra_studies.paper_values import PAPER_SIZE_PX
from catoptra_studies.study_subject import (
    REFERENCE_SAMPLES,
    StudySubject,
    open_study_subject,
    resize_camera,
)

# rms and maximum in px by (sectors, rings): interpolation of positions, then of UV coordinates.
_REFERENCE_DISPLACEMENT_PX = {
    (4, 4): ((39.6, 91.8), (37.5, 91.3)),
    (8, 8): ((9.706, 21.28), (11.3, 24.6)),
    (16, 16): ((2.422, 5.251), (2.95, 7.28)),
    (32, 32): ((0.6048, 1.317), (0.747, 2.03)),
    (64, 64): ((0.1512, 0.3315), (0.187, 0.543)),
    (8, 2): ((15.28, 24.87), (32.0, 85.6)),
    (16, 4): ((3.733, 6.606), (3.74, 10.2)),
    (32, 8): ((0.9279, 1.727), (0.959, 2.97)),
    (64, 16): ((0.2317, 0.4431), (0.241, 0.737)),
    (128, 32): ((0.0579, 0.1121), (0.0603, 0.193)),
}


def measure_polygon_rows(camera: OmniCamera) -> tuple[PolygonRow, ...]:
    """Measure all tessellations with both interpolations, at the paper's image size."""
    resized = resize_camera(camera, PAPER_SIZE_PX)
    return tuple(
        _polygon_row(resized, Tessellation(sectors, rings, interpolation))
        for interpolation in Interpolation
        for sectors, rings in (*SQUARE_TESSELLATIONS, *WIDE_TESSELLATIONS)
    )


def _polygon_row(camera: OmniCamera, tessellation: Tessellation) -> PolygonRow:
    error = measure_polygon_error(camera, tessellation)
    mirror = camera.mirror
    is_paper = isinstance(mirror, HyperbolicMirror) and math.isclose(mirror.k, PAPER_MIRROR.k)
    if is_paper and math.isclose(camera.rim_rad, math.radians(120.0)):
        position, uv = _REFERENCE_DISPLACEMENT_PX[tessellation.sectors, tessellation.rings]
        is_position = tessellation.interpolation is Interpolation.POSITION
        reference_px = position if is_position else uv
    else:
        # No None: the report leaves the columns out where no row has a reference.
        reference_px = 0.0, 0.0
    return PolygonRow(
        num_polygons=tessellation.num_polygons,
        sectors=tessellation.sectors,
        rings=tessellation.rings,
        interpolation=tessellation.interpolation.value,
        coverage=error.coverage,
        rms_px=error.rms_px,
        max_px=error.max_px,
        reference_rms_px=reference_px[0],
        reference_max_px=reference_px[1],
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
        # With 32 frames medians repeat to about MIN_GAIN.
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

    The localization of the results is None: `localization_study` measures that part.
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
        frame_rates=measure_all_frame_rates(config, progress),
    )


def measure_all_frame_rates(
    config: CostStudyConfig, progress: ProgressDisplay
) -> tuple[FrameRate, ...]:
    """Measure the frame rates of the paper's Figure 10 in all worlds."""
    return tuple(
        row
        for file in config.world_files
        for row in _measure_world_frame_rates(config, file, progress)
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
