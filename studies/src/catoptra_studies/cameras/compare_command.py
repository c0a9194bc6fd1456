"""The command `catoptra-studies compare`: which camera for a task, as a table and a picture.

Every camera is on the same robot, at the same place. Resolutions follow from the camera model; the
blind zone is that of the model or, where the robot hides more of the floor, of the image's labels.
The drives are the paper's simulated ones, over sockets: a detector trained with the camera's own
frames finds the landmarks. The same seeds drive with every camera, so that runs are compared in
pairs: few runs do not separate the cameras, and those that differ are listed with their level. The
tables are Markdown on the terminal, CSV and JSON in files.
"""

from __future__ import annotations

import argparse
import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catoptra_protocol.command_line import parse_count, parse_integer
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies.cameras.camera_metrics import covered_sphere, floor_view, resolution_at
from catoptra_studies.cameras.camera_stage import (
    CameraStage,
    StagedCamera,
    add_camera_options,
    open_requested_stage,
)
from catoptra_studies.commands import add_output, make_parser, parse_study, print_line
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import CONSISTENT_FILTER, PAPER_FILTER, SIM
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.plot_style import BLUE, ORANGE, PAGE_WIDTH_IN, open_chart
from catoptra_studies.reports import format_number, markdown_table, replace_non_finite, write_json
from catoptra_studies.run_statistics import (
    LEVEL,
    compare_pairs,
    median_with_interval,
)

_FLOOR_DISTANCE_M = 3.0
_NUM_TRAINING_FRAMES = 20


def main(arguments: Sequence[str]) -> int:
    """Compare cameras."""
    parser = make_parser(
        "compare",
        "Compare cameras on the same robot: resolution on the floor and at the horizon, blind "
        "zone, localization on the paper's route, and milliseconds a frame.",
    )
    add_camera_options(parser, size_px=360)
    add_output(parser, "out/compare", "folder for comparison.csv, .json and .png")
    add = parser.add_argument
    add("--runs", type=parse_count, default=20, metavar="N", help="drives with each camera")
    add("--seed", type=parse_integer, default=0, metavar="N",
        help="seed of all random numbers: all results but the times follow from it")  # fmt: skip
    return _run(parse_study(parser, arguments))


# Numbers of one camera by the keys of `_COLUMNS`; nan where the camera does not show an angle. Keys
# with `_low` and `_high` are the ends of an interval.
_Row = dict[str, float]
# Numbers of each run by the keys of `_DRIVE_KEYS`.
_Runs = Mapping[str, Floats]


def _run(parsed: argparse.Namespace) -> int:
    with open_requested_stage(parsed) as (stage, on_camera):
        frame_ms = stage.time_frames(parsed.frames)
        rows, drives = [], {}
        for index, (staged, ms) in enumerate(zip(stage.cameras, frame_ms, strict=True)):
            runs = _drive_with_camera(stage, staged, parsed) if stage.landmarks else {}
            view = _describe_view(stage, index)
            rows.append((staged.file.name, {**view, **_summarize_runs(runs), "frame_ms": ms}))
            drives[staged.file.name] = runs
            on_camera()
    text = _format_comparison(rows, drives if stage.landmarks else {}, parsed.runs)
    _write_comparison(rows, parsed.out)
    (parsed.out / "comparison.md").write_text(text + "\n", encoding="utf-8")
    print_line(text)
    if not stage.landmarks:
        print_line(f"{stage.world_file} has no landmarks: nothing to localize by, so no drives")
    print_line(f"written: {parsed.out}")
    return 0


def _describe_view(stage: CameraStage, index: int) -> _Row:
    """Numbers of a camera without a drive; resolutions in pixels per degree."""
    camera, height_m = stage.cameras[index].camera, stage.cameras[index].height_m
    floor = resolution_at(camera, math.atan2(_FLOOR_DISTANCE_M, height_m))
    horizon = resolution_at(camera, 0.5 * math.pi)
    blind_radius_m, reach_m = floor_view(camera, height_m)
    return {
        "covered_sphere": covered_sphere(camera),
        "floor_radial": floor[0],
        "floor_tangential": floor[1],
        "horizon_radial": horizon[0],
        "horizon_tangential": horizon[1],
        "blind_radius_m": max(blind_radius_m, stage.hidden_floor_m(index)),
        "floor_reach_m": reach_m,
    }


def _drive_with_camera(
    stage: CameraStage, staged: StagedCamera, parsed: argparse.Namespace
) -> _Runs:
    """Train a detector with the camera's frames, and drive every run."""
    folder = parsed.out.resolve() / staged.file.name
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
    # The start is given, and has no landmarks.
    measured = np.array([(run.num_measured[1:] > 0).mean() for run in paper])
    numbers = (*_run_errors(paper), *_run_errors(consistent), measured)
    return dict(zip(_DRIVE_KEYS, numbers, strict=True))


def _run_errors(filter_runs: Sequence[FilterRun]) -> tuple[Floats, Floats]:
    """Mean and 90 % quantile of the position errors of each run over its steps."""
    errors_m = np.array([run.estimate_error_m[1:] for run in filter_runs])
    return errors_m.mean(axis=1), np.quantile(errors_m, 0.9, axis=1)


def _summarize_runs(runs: _Runs) -> _Row:
    """Medians over the runs with their intervals; nan without runs."""
    row: _Row = {}
    for key in _DRIVE_KEYS:
        numbers = median_with_interval(runs[key]) if runs else (math.nan,) * 3
        row |= dict(zip((key, f"{key}_low", f"{key}_high"), numbers, strict=True))
    return row


# Position errors of a run with the paper's filter and with one of consistent noises, mean and 90 %
# of its steps, and the fraction of its steps in which a landmark was measured.
_DRIVE_KEYS = (
    *("ekf_mean_m", "ekf_p90_m", "consistent_mean_m", "consistent_p90_m"),
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
    "ekf_mean_m": "paper's filter, mean m",
    "ekf_p90_m": "90 %, m",
    "consistent_mean_m": "consistent filter, mean m",
    "consistent_p90_m": "90 %, m",
    "steps_with_landmarks": "steps with landmarks",
    "frame_ms": "ms a frame",
}
# Errors by which cameras are compared.
_COMPARED = {"ekf_mean_m": "the paper's filter", "consistent_mean_m": "the consistent filter"}
# Panels of the picture: key, title.
_PANELS = (
    ("floor_radial", f"px per degree, floor at {_FLOOR_DISTANCE_M:g} m"),
    ("horizon_tangential", "px per degree of bearing at the horizon"),
    ("blind_radius_m", "blind zone: radius of floor not seen, m"),
    ("ekf_mean_m", "mean position error, the paper's filter, m"),
    ("steps_with_landmarks", "fraction of steps with landmarks"),
    ("frame_ms", "processor time of a frame, ms"),
)  # fmt: skip


def _format_comparison(
    rows: Sequence[tuple[str, _Row]], drives: Mapping[str, _Runs], num_runs: int
) -> str:
    """The table of all numbers, and the pairs of cameras that differ."""
    # A dash where a camera does not show an angle or has not been driven.
    cells = [[name, *(_format_cell(row, key) for key in _COLUMNS)] for name, row in rows]
    parts = [markdown_table(["camera", *_COLUMNS.values()], cells)]
    if drives:
        parts.append(
            f"Errors and steps: medians of {num_runs} runs; in brackets intervals of 95 %, from "
            "six runs on."
        )
    if len(drives) > 1:
        parts += [_format_differences(key, drives) for key in _COMPARED]
    return "\n\n".join(parts)


def _format_cell(row: _Row, key: str) -> str:
    low, high = (row.get(f"{key}_{end}", math.nan) for end in ("low", "high"))
    interval = "" if math.isnan(low) else f" [{format_number(low)}, {format_number(high)}]"
    return format_number(row[key]) + interval


def _format_differences(key: str, drives: Mapping[str, _Runs]) -> str:
    """Pairs of cameras whose errors differ, in a table with the level of each."""
    pairs = compare_pairs({name: runs[key] for name, runs in drives.items()})
    decided = [pair for pair in pairs if pair.is_decided]
    rows = [
        [f"{pair.lower} below {pair.higher}", str(pair.runs), f"{pair.p_value:.2g}"]
        for pair in decided
    ]
    table = markdown_table(("mean error of", "in", "level"), rows) if rows else ""
    return (
        f"By {_COMPARED[key]}, {len(decided)} of {len(pairs)} pairs of cameras differ at the level "
        f"{LEVEL:g} of all pairs together (sign test, Holm); the others are not decided.\n\n{table}"
    ).strip()


def _write_comparison(rows: Sequence[tuple[str, _Row]], folder: Path) -> None:
    """Write comparison.csv, comparison.json and comparison.png; no number is null in JSON."""
    flat = [{"camera": name, **row} for name, row in rows]
    with (folder / "comparison.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [*flat[0]])
        writer.writeheader()
        writer.writerows(flat)
    write_json(folder / "comparison.json", replace_non_finite(flat))
    _draw_comparison(rows, folder / "comparison.png")


def _draw_comparison(rows: Sequence[tuple[str, _Row]], path: Path) -> None:
    # Without drives their panels would be empty.
    shown = [panel for panel in _PANELS if any(math.isfinite(row[panel[0]]) for _, row in rows)]
    num_lines = -(-len(shown) // 2)
    size = (PAGE_WIDTH_IN, 1.0 + 0.25 * num_lines * len(rows))
    with open_chart(path, figsize=size) as figure:
        grid = figure.subplots(num_lines, 2, squeeze=False, sharey=True).flat
        for (key, title), axes in zip(shown, grid, strict=False):
            values, ends = (
                np.array([[row.get(k, math.nan) for k in keys] for _, row in rows])
                for keys in ((key,), (f"{key}_low", f"{key}_high"))
            )
            widths = np.where(np.isfinite(values[:, 0]), values[:, 0], 0.0)
            axes.barh([name for name, _ in rows], widths, color=BLUE, height=0.6)
            # No lines where there is no interval, and texts right of either.
            axes.hlines(range(len(rows)), *ends.T, color=ORANGE, lw=2)
            for place, (value,) in enumerate(values):
                right = np.nanmax([widths[place], *ends[place]])
                axes.annotate(format_number(value), (right, place), (3, 0),
                              textcoords="offset points", va="center", fontsize=7)  # fmt: skip
            axes.set_title(title)
            axes.margins(x=0.15)
            axes.set_xlim(left=0.0)
            axes.grid(visible=False, axis="y")
        # Shared by all panels: the first camera is at the top.
        axes.invert_yaxis()
        for unused in grid:
            unused.set_axis_off()
