"""The command `catoptra-studies compare`: which camera for a task, as a table and a picture.

Every camera is on the same robot, at the same place. Resolution and floor follow from the camera
model; the drives are the paper's simulated ones, over sockets: a detector trained with the camera's
own frames finds the landmarks. The table is Markdown on the terminal, CSV and JSON in files.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_studies import plot_style
from catoptra_studies.cameras.camera_metrics import covered_sphere, floor_view, resolution_at
from catoptra_studies.cameras.camera_stage import (
    CameraStage,
    StagedCamera,
    add_camera_options,
    open_requested_stage,
)
from catoptra_studies.commands import add_output, make_parser, print_line, run_study
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    SetupResult,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER, PAPER_FILTER, SIM
from catoptra_studies.reports import format_number, markdown_table, replace_non_finite, write_json

_FLOOR_DISTANCE_M = 3.0
_NUM_TRAINING_FRAMES = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare cameras; return 0, or 2 after one line about the reason."""
    parser = make_parser(
        "compare",
        "Compare cameras on the same robot: resolution on the floor and at the horizon, blind "
        "zone, localization on the paper's route, and milliseconds a frame.",
    )
    add_camera_options(parser, size_px=360)
    add_output(parser, "out/compare", "folder for comparison.csv, .json and .png")
    add = parser.add_argument
    add("--runs", type=int, default=3, metavar="N",
        help="drives with each camera, 0 for none (default 3)")  # fmt: skip
    add("--seed", type=int, default=0,
        help="seed of all random numbers: all results but the times follow from it")  # fmt: skip
    return run_study("catoptra-studies compare", parser.parse_args(arguments), _run)


def _run(parsed: argparse.Namespace) -> int:
    plan = DrivePlan(parsed.runs, parsed.seed, parsed.output.resolve())
    with open_requested_stage(parsed) as (stage, on_camera):
        rows = compare_cameras(stage, plan, num_timed=parsed.frames, on_camera=on_camera)
    write_comparison(rows, parsed.output)
    print_line(format_comparison(rows))
    if not stage.landmarks:
        print_line(f"{stage.world_file} has no landmarks: nothing to localize by, so no drives")
    print_line(f"written: {parsed.output}")
    return 0


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
    """Pixels per degree along the image radius at 3 m on the floor."""

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

    num_runs: int
    """Drives with each camera; 0 for none."""
    seed: int
    folder: Path


def compare_cameras(
    stage: CameraStage, plan: DrivePlan, *, num_timed: int, on_camera: Callable[[], None]
) -> tuple[CameraRow, ...]:
    """Compare all cameras of a stage.

    Args:
        stage: World with the cameras.
        plan: Drives with each; none in a world without landmarks.
        num_timed: Frames of each camera that are timed.
        on_camera: Called after each camera.
    """
    has_drives = plan.num_runs > 0 and stage.landmarks
    frame_ms = stage.time_frames(num_timed)
    rows = []
    for staged, ms in zip(stage.cameras, frame_ms, strict=True):
        drives = _drive_with_camera(stage, staged, plan) if has_drives else NO_DRIVES
        rows.append(make_row(staged, drives, ms))
        on_camera()
    return tuple(rows)


def make_row(staged: StagedCamera, drives: DriveMetrics, frame_ms: float) -> CameraRow:
    """Put the numbers of a camera together."""
    camera, height_m = staged.camera, staged.height_m
    floor = resolution_at(camera, math.atan2(_FLOOR_DISTANCE_M, height_m))
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


def _drive_with_camera(stage: CameraStage, staged: StagedCamera, plan: DrivePlan) -> DriveMetrics:
    """Train a detector with the camera's frames, drive every run and summarize."""
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
        other_world=(stage.world_file.resolve(), stage.landmarks),
    )
    classifier, _ = train_classifier(config, lambda _: None)
    return _summarize_drives(run_setup(config, setup, classifier, lambda _: None))


def _summarize_drives(result: SetupResult) -> DriveMetrics:
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


# Keys of a flat row, and labels.
_COLUMNS = {
    "covered_sphere": "covered sphere",
    "floor_radial": f"px/deg at {_FLOOR_DISTANCE_M:g} m",
    "floor_tangential": "across",
    "horizon_radial": "px/deg at horizon",
    "horizon_tangential": "across",
    "blind_radius_m": "blind zone, m",
    "floor_reach_m": "floor seen to, m",
    "ekf_median_m": "EKF median, m",
    "ekf_p90_m": "EKF 90 %, m",
    "consistent_median_m": "consistent EKF median, m",
    "consistent_p90_m": "90 %, m",
    "steps_with_landmarks": "steps with landmarks",
    "frame_ms": "ms a frame",
}
# Panels of the picture: key, title.
_PANELS = (
    ("floor_radial", f"px per degree, floor at {_FLOOR_DISTANCE_M:g} m"),
    ("horizon_tangential", "px per degree of bearing at the horizon"),
    ("blind_radius_m", "blind zone: radius of floor not seen, m"),
    ("ekf_p90_m", "position error, 90 % of the steps, m"),
    ("steps_with_landmarks", "fraction of steps with landmarks"),
    ("frame_ms", "processor time of a frame, ms"),
)  # fmt: skip


def _flatten_row(row: CameraRow) -> dict[str, str | float]:
    """One level of keys, in the order of the table."""
    values = asdict(row)
    values |= values.pop("drives")
    return {"camera": row.name} | {key: values[key] for key in _COLUMNS}


def format_comparison(rows: Sequence[CameraRow]) -> str:
    """Markdown table; a dash where a camera does not show an angle or has not been driven."""
    cells = [
        [row.name, *(format_number(float(value)) for value in [*_flatten_row(row).values()][1:])]
        for row in rows
    ]
    return markdown_table(["camera", *_COLUMNS.values()], cells)


def write_comparison(rows: Sequence[CameraRow], folder: Path) -> None:
    """Write comparison.csv, comparison.json and comparison.png; no number is null in JSON."""
    flat = [_flatten_row(row) for row in rows]
    with (folder / "comparison.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ["camera", *_COLUMNS])
        writer.writeheader()
        writer.writerows(flat)
    write_json(folder / "comparison.json", replace_non_finite(flat))
    _draw_comparison(flat, folder / "comparison.png")


def _draw_comparison(flat: Sequence[dict[str, str | float]], path: Path) -> None:
    size = (plot_style.PAGE_WIDTH_IN, 1.0 + 0.75 * len(flat))
    with plot_style.open_chart(path, figsize=size) as figure:
        names = [str(row["camera"]) for row in flat]
        for axes, (key, title) in zip(
            figure.subplots(3, 2, sharey=True).flat, _PANELS, strict=True
        ):
            values = [float(row[key]) for row in flat]
            widths = [value if math.isfinite(value) else 0.0 for value in values]
            axes.barh(names, widths, color=plot_style.BLUE, height=0.6)
            for place, value in enumerate(values):
                label = "-" if math.isnan(value) else format_number(value)
                axes.annotate(label, (widths[place], place), (3, 0), textcoords="offset points",
                              va="center", fontsize=7)  # fmt: skip
            axes.set_title(title)
            axes.margins(x=0.15)
            axes.set_xlim(left=0.0)
            axes.grid(visible=False, axis="y")
        # Shared by all panels: the first camera is at the top.
        axes.invert_yaxis()
