"""The command `catoptra-studies compare`: which camera for a task, as a table and a picture.

Every camera is on the same robot, at the same place. Resolution and floor follow from the camera
model; the drives are the paper's simulated ones, over sockets: a detector trained with the camera's
own frames finds the landmarks. The table is Markdown on the terminal, CSV and JSON in files.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.numerics import Floats
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
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER, PAPER_FILTER, SIM
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.plot_style import BLUE, PAGE_WIDTH_IN, open_chart
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


# Numbers of one camera by the keys of `_COLUMNS`; nan where the camera does not show an angle.
_Row = dict[str, float]


def _run(parsed: argparse.Namespace) -> int:
    with open_requested_stage(parsed) as (stage, on_camera):
        frame_ms = stage.time_frames(parsed.frames)
        rows = []
        for staged, ms in zip(stage.cameras, frame_ms, strict=True):
            drives = _drive_with_camera(stage, staged, parsed)
            rows.append((staged.file.name, {**_describe_view(staged), **drives, "frame_ms": ms}))
            on_camera()
    _write_comparison(rows, parsed.output)
    # A dash where a camera does not show an angle or has not been driven.
    cells = [[name, *map(format_number, row.values())] for name, row in rows]
    print_line(markdown_table(["camera", *_COLUMNS.values()], cells))
    if not stage.landmarks:
        print_line(f"{stage.world_file} has no landmarks: nothing to localize by, so no drives")
    print_line(f"written: {parsed.output}")
    return 0


def _describe_view(staged: StagedCamera) -> _Row:
    """Numbers of a camera that follow from its model; resolutions in pixels per degree."""
    camera, height_m = staged.camera, staged.height_m
    floor = resolution_at(camera, math.atan2(_FLOOR_DISTANCE_M, height_m))
    horizon = resolution_at(camera, 0.5 * math.pi)
    blind_radius_m, reach_m = floor_view(camera, height_m)
    return {
        "covered_sphere": covered_sphere(camera),
        "floor_radial": floor[0],
        "floor_tangential": floor[1],
        "horizon_radial": horizon[0],
        "horizon_tangential": horizon[1],
        "blind_radius_m": blind_radius_m,
        "floor_reach_m": reach_m,
    }


def _drive_with_camera(
    stage: CameraStage, staged: StagedCamera, parsed: argparse.Namespace
) -> _Row:
    """Train a detector with the camera's frames, drive every run and summarize.

    Without runs or landmarks nothing is driven, and every number is nan.
    """
    if parsed.runs <= 0 or not stage.landmarks:
        return dict.fromkeys(_DRIVE_KEYS, math.nan)
    folder = parsed.output.resolve() / staged.file.name
    folder.mkdir(parents=True, exist_ok=True)
    setup = replace(SIM, name=staged.file.name, robot_file=str(staged.robot_file))
    config = ExperimentConfig(
        config_folder=None,
        output_folder=folder,
        setups=(setup,),
        num_runs=parsed.runs,
        seed=parsed.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        server_arguments=("--renderer", "trace"),
        other_world=(stage.world_file.resolve(), stage.landmarks),
    )
    classifier, _ = train_classifier(config)
    runs = run_setup(config, setup, classifier).filter_runs
    paper, consistent = runs[PAPER_FILTER.name], runs[CONSISTENT_FILTER.name]
    num_measured = np.concatenate([run.num_measured[1:] for run in paper])
    numbers = (*_error_quantiles(paper), *_error_quantiles(consistent), (num_measured > 0).mean())
    return dict(zip(_DRIVE_KEYS, map(float, numbers), strict=True))


def _error_quantiles(filter_runs: Sequence[FilterRun]) -> Floats:
    """Median and 90 % of the position error over all steps of all drives, the starts left out."""
    errors_m = np.concatenate([run.estimate_error_m[1:] for run in filter_runs])
    quantiles: Floats = np.quantile(errors_m, [0.5, 0.9])
    return quantiles


# Position errors of the paper's filter and of one with consistent noises over all steps of all
# drives, and the fraction of the steps in which a landmark was measured.
_DRIVE_KEYS = (
    *("ekf_median_m", "ekf_p90_m", "consistent_median_m", "consistent_p90_m"),
    "steps_with_landmarks",
)
# Keys of a row in their order, and labels.
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


def _write_comparison(rows: Sequence[tuple[str, _Row]], folder: Path) -> None:
    """Write comparison.csv, comparison.json and comparison.png; no number is null in JSON."""
    flat = [{"camera": name, **row} for name, row in rows]
    with (folder / "comparison.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ["camera", *_COLUMNS])
        writer.writeheader()
        writer.writerows(flat)
    write_json(folder / "comparison.json", replace_non_finite(flat))
    _draw_comparison(rows, folder / "comparison.png")


def _draw_comparison(rows: Sequence[tuple[str, _Row]], path: Path) -> None:
    size = (PAGE_WIDTH_IN, 1.0 + 0.75 * len(rows))
    with open_chart(path, figsize=size) as figure:
        panels = figure.subplots(3, 2, sharey=True).flat
        for axes, (key, title) in zip(panels, _PANELS, strict=True):
            values = [row[key] for _, row in rows]
            widths = [value if math.isfinite(value) else 0.0 for value in values]
            axes.barh([name for name, _ in rows], widths, color=BLUE, height=0.6)
            for place, value in enumerate(values):
                axes.annotate(format_number(value), (widths[place], place), (3, 0),
                              textcoords="offset points", va="center", fontsize=7)  # fmt: skip
            axes.set_title(title)
            axes.margins(x=0.15)
            axes.set_xlim(left=0.0)
            axes.grid(visible=False, axis="y")
        # Shared by all panels: the first camera is at the top.
        axes.invert_yaxis()
