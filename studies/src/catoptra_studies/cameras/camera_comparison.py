"""Comparison of cameras for a task: resolution, floor, localization and cost of each.

Every camera is on the same robot, at the same place. The drives are the paper's simulated ones,
over sockets: a detector trained with the camera's own frames finds the landmarks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_studies.cameras.camera_metrics import covered_sphere, floor_view, resolution_at
from catoptra_studies.cameras.camera_stage import CameraStage, StagedCamera
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    SetupResult,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER, PAPER_FILTER, SIM

FLOOR_DISTANCE_M = 3.0
_NUM_TRAINING_FRAMES = 20


@dataclass(frozen=True, slots=True)
class DriveMetrics:
    """Localization over all steps of all drives with one camera."""

    ekf_median_m: float
    """Position error of the paper's filter."""

    ekf_p90_m: float
    consistent_median_m: float
    """The same of a filter with consistent noises."""

    consistent_p90_m: float

    steps_with_landmarks: float
    """Fraction of the steps in which a landmark was measured."""


NO_DRIVES = DriveMetrics(math.nan, math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True, slots=True)
class CameraRow:
    """One camera of the comparison; nan where the camera does not show an angle."""

    name: str
    covered_sphere: float

    floor_radial: float
    """Pixels per degree along the image radius at FLOOR_DISTANCE_M on the floor."""

    floor_tangential: float
    horizon_radial: float
    horizon_tangential: float

    blind_radius_m: float
    """Radius of the circle of the floor that is not seen, the robot itself excluded."""

    floor_reach_m: float
    """Distance to which the floor is seen; inf with the horizon."""

    drives: DriveMetrics
    frame_ms: float
    """Processor time."""


@dataclass(frozen=True, slots=True)
class DrivePlan:
    """Extent of the drives."""

    world_file: Path
    landmarks: tuple[Landmark, ...]
    num_runs: int
    seed: int
    folder: Path


def compare_cameras(
    stage: CameraStage, plan: DrivePlan, *, num_timed: int, on_camera: Callable[[], None]
) -> tuple[CameraRow, ...]:
    """Compare all cameras of a stage.

    Args:
        stage: World with the cameras.
        plan: Drives with each; none without runs or landmarks.
        num_timed: Frames of each camera that are timed.
        on_camera: Called after each camera.
    """
    frame_ms = stage.time_frames(num_timed, lambda: None)
    rows = []
    for staged, ms in zip(stage.cameras, frame_ms, strict=True):
        has_drives = plan.num_runs > 0 and plan.landmarks
        drives = summarize_drives(drive_with_camera(staged, plan)) if has_drives else NO_DRIVES
        rows.append(make_row(staged, drives, ms))
        on_camera()
    return tuple(rows)


def make_row(staged: StagedCamera, drives: DriveMetrics, frame_ms: float) -> CameraRow:
    """Put the numbers of a camera together."""
    camera, height_m = staged.camera, staged.height_m
    floor = resolution_at(camera, math.atan2(FLOOR_DISTANCE_M, height_m))
    horizon = resolution_at(camera, 0.5 * math.pi)
    view = floor_view(camera, height_m)
    return CameraRow(
        name=staged.file.name,
        covered_sphere=covered_sphere(camera),
        floor_radial=floor.radial,
        floor_tangential=floor.tangential,
        horizon_radial=horizon.radial,
        horizon_tangential=horizon.tangential,
        blind_radius_m=view.blind_radius_m,
        floor_reach_m=view.reach_m,
        drives=drives,
        frame_ms=frame_ms,
    )


def drive_with_camera(staged: StagedCamera, plan: DrivePlan) -> SetupResult:
    """Train a detector with the camera's frames and drive every run."""
    folder = plan.folder / staged.file.name
    folder.mkdir(parents=True, exist_ok=True)
    setup = replace(SIM, name=staged.file.name, robot_file=str(staged.robot_file))
    config = ExperimentConfig(
        config_folder=None,
        output_folder=folder,
        setups=(setup,),
        num_runs=plan.num_runs,
        seed=plan.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        server_arguments=("--renderer", "trace"),
        other_world=(plan.world_file.resolve(), plan.landmarks),
    )
    classifier, _ = train_classifier(config, lambda _: None)
    return run_setup(config, setup, classifier, lambda _: None)


def summarize_drives(result: SetupResult) -> DriveMetrics:
    """Quantiles of the position error over all steps of all drives, the starts left out."""
    paper = result.filter_runs[PAPER_FILTER.name]
    consistent = result.filter_runs[CONSISTENT_FILTER.name]
    paper_m = _quantiles([run.estimate_error_m[1:] for run in paper])
    consistent_m = _quantiles([run.estimate_error_m[1:] for run in consistent])
    num_measured = np.concatenate([run.num_measured[1:] for run in paper])
    return DriveMetrics(*paper_m, *consistent_m, float((num_measured > 0).mean()))


def _quantiles(errors_m: Sequence[np.ndarray[tuple[int]]]) -> tuple[float, float]:
    median, p90 = np.quantile(np.concatenate(errors_m), [0.5, 0.9])
    return float(median), float(p90)
