"""Report of the degraded images: degradation.json, DEGRADATION.md and the plots.

The plot of a sweep has an example frame of each level above detection rates and position errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    ExampleFrame,
    Pixel,
    find_failure_levels,
    rms_difference,
)
from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M
from catoptra_studies.plot_style import (
    ACCEPTED,
    MUTED,
    ODOMETRY,
    REJECTED,
    Axes,
    add_legend,
    open_chart,
)
from catoptra_studies.reports import markdown_table, wrap_paragraph, write_json

_NUM_COLUMNS = 4
_TRAINING_STYLES = (
    (TRAINED_ON_CLEAN, REJECTED, "o-", "trained on clean images"),
    (TRAINED_ON_DEGRADED, ACCEPTED, "s--", "retrained on such images"),
)


def _draw_sweep(path: Path, result: SweepResult) -> None:
    """Write the plot of one sweep: an example of each level above rate and error."""
    levels = _all_levels(result)
    with open_chart(path, figsize=(2.2 * len(levels), 5.0)) as figure:
        above, below = figure.subfigures(2, 1, height_ratios=(1.25, 1.0))
        above.suptitle(f"{result.sweep.name}: {result.sweep.description}\n", fontweight="bold")
        for axes, level in zip(above.subplots(1, len(levels)), levels, strict=True):
            _draw_example(axes, level.example)
            axes.set_title(_example_title(level))
        rate_axes, error_axes = below.subplots(1, 2)
        _draw_curves(rate_axes, error_axes, result)
        for axes in (rate_axes, error_axes):
            axes.set_xlabel(result.sweep.unit)
        # The error axes have every series; the rate axes lack odometry.
        add_legend(figure, error_axes, loc="outside lower center", ncols=3)


def _draw_all_sweeps(path: Path, results: Sequence[SweepResult]) -> None:
    """Write the curves of all sweeps, each a detection rate above a position error."""
    num_rows = math.ceil(len(results) / _NUM_COLUMNS)
    with open_chart(path, figsize=(3.0 * _NUM_COLUMNS, 3.5 * num_rows)) as figure:
        cells = figure.subfigures(num_rows, _NUM_COLUMNS, squeeze=False).flat
        # The last row may have more cells than there are sweeps.
        for cell, result in zip(cells, results, strict=False):
            rate_axes, error_axes = cell.subplots(2, 1, sharex=True)
            _draw_curves(rate_axes, error_axes, result)
            rate_axes.set_title(result.sweep.name)
            error_axes.set_xlabel(result.sweep.unit)
        add_legend(figure, error_axes, loc="outside lower center", ncols=3)


def _draw_curves(rate_axes: Axes, error_axes: Axes, result: SweepResult) -> None:
    """Draw percentages of beacons found, and the filter's errors with the paper's bound."""
    levels = _all_levels(result)
    labels = [level.label for level in levels]
    for training, colour, line, label in _TRAINING_STYLES:
        metrics = [_metrics(level, training) for level in levels]
        style = {"color": colour, "label": label}
        rate_axes.plot(labels, [100.0 * m.detection_rate for m in metrics], line, **style)
        error_axes.plot(labels, [m.ekf_max_m for m in metrics], line, **style)
    odometry_m = [_metrics(level, TRAINED_ON_CLEAN).odometry_max_m for level in levels]
    error_axes.plot(labels, odometry_m, ":", color=ODOMETRY, label="odometry alone")
    error_axes.axhline(PAPER_EKF_ERROR_M, color=MUTED, lw=1, ls="--")
    # Markers at 0 and 100 % would be cut in half.
    rate_axes.set(ylim=(-4, 104), ylabel="beacons found, %")
    error_axes.set_ylim(bottom=0.0)
    error_axes.set_ylabel("EKF's largest error, m")


def _all_levels(result: SweepResult) -> tuple[LevelResult, ...]:
    return (result.clean, *result.levels)


def _metrics(level: LevelResult, training: str) -> DegradationMetrics:
    # Both curves begin at the clean images, which have one classifier only.
    return level.metrics.get(training, level.metrics[TRAINED_ON_CLEAN])


def _example_title(level: LevelResult) -> str:
    example = level.example
    num_detected, num_false = len(example.detected_px), len(example.false_bearings_rad)
    false = f", {num_false} false" if num_false else ""
    return f"{level.label}\n{num_detected} of {num_detected + len(example.missed_px)}{false}"


def _draw_example(axes: Axes, example: ExampleFrame) -> None:
    """Draw the frame: rings on detected beacons, crosses on missed ones, rays to false ones."""
    axes.imshow(example.rgb)
    _draw_markers(axes, example.detected_px, "o", "white")
    _draw_markers(axes, example.missed_px, "x", ODOMETRY)
    u, v = example.centre_px
    reach_px = 0.45 * example.rgb.shape[0]
    for bearing_rad in example.false_bearings_rad:
        # Forward is up; bearings grow to the robot's right, which a mirror shows on the left.
        end = (u - reach_px * math.sin(bearing_rad), v - reach_px * math.cos(bearing_rad))
        axes.plot([u, end[0]], [v, end[1]], color=REJECTED, lw=1.5)
    axes.set_axis_off()


def _draw_markers(axes: Axes, pixels: Sequence[Pixel], marker: str, colour: str) -> None:
    if pixels:
        u, v = zip(*pixels, strict=True)
        axes.plot(u, v, marker, color=colour, ms=11, mfc="none", mew=2.0)


_FORMAT_VERSION = 2

_REPORT_HEADER = """\
# What degraded images do to colour classification

Written by `make effects`. {runs} drives of {frames} frames a level, the same seeds everywhere. A
beacon counts as found within 5° of its bearing, of those that the stream reports as visible within
2.5 m. The filter is the paper's; its errors are medians over the drives. The classifier was trained
on clean images, like the paper's; "retrained": on images of the level. "Grey levels": rms
difference from the clean image at the same pose. Odometry alone is off by up to {odometry:.2f} m.
"""
_LEVEL_HEADER = (
    *("grey levels", "found", "false a frame", "bearing", "range", "EKF largest", "EKF final"),
    *("retrained: found", "false a frame", "EKF largest"),
)
_FAILURE_HEADER = (
    *("sweep", "unit", "levels", "found < 90 %", "< 50 %", "EKF > 2x", "> 0.6 m"),
    *("retrained: < 90 %", "< 50 %", "> 0.6 m"),
)


def write_degradation_results(
    output_folder: Path, config: ExperimentConfig, results: Sequence[SweepResult]
) -> None:
    """Write degradation.json, DEGRADATION.md, degradation.png and a plot for each sweep."""
    summary = {
        "version": _FORMAT_VERSION,
        "num_runs": config.num_runs,
        "seed": config.seed,
        "sweeps": [_summarize_sweep(result) for result in results],
    }
    # A metric without values is None; nan is a bug, and raises.
    write_json(output_folder / "degradation.json", summary)
    report = _format_report(results, num_runs=config.num_runs)
    (output_folder / "DEGRADATION.md").write_text(report, encoding="utf-8")
    _draw_all_sweeps(output_folder / "degradation.png", results)
    for result in results:
        _draw_sweep(output_folder / f"degradation_{result.sweep.slug}.png", result)


def _failure_levels_by_training(result: SweepResult) -> dict[str, dict[str, str | None]]:
    """Failing levels of a sweep for both classifiers."""
    # Both are compared with the clean result of the one classifier that has seen clean images.
    clean = result.clean.metrics[TRAINED_ON_CLEAN]
    return {
        training: find_failure_levels(
            clean, [(level.label, level.metrics[training]) for level in result.levels]
        )
        for training in (TRAINED_ON_CLEAN, TRAINED_ON_DEGRADED)
    }


def _summarize_sweep(result: SweepResult) -> dict[str, Any]:
    sweep = result.sweep
    return {
        "name": sweep.name,
        "description": sweep.description,
        "unit": sweep.unit,
        "ini_keys": sweep.ini_keys.split("|") if sweep.ini_keys else [],
        "clean": _summarize_level(result.clean, result),
        "levels": [
            # Results join the table: a result has the label of a level, not the keys.
            {**_summarize_level(level, result), "ini_keys": sweep.levels[level.label].split("|")}
            for level in result.levels
        ],
        "failure_levels": _failure_levels_by_training(result),
    }


def _summarize_level(level: LevelResult, result: SweepResult) -> dict[str, Any]:
    return {
        "label": level.label,
        "rms_difference_grey_levels": rms_difference(level.example, result.clean.example),
        "trained_on": {
            training: {**asdict(metrics), "detection_rate": metrics.detection_rate}
            for training, metrics in level.metrics.items()
        },
    }


def _format_report(results: Sequence[SweepResult], *, num_runs: int) -> str:
    """The report as Markdown: failing levels first, then the levels of each sweep."""
    clean = results[0].clean.metrics[TRAINED_ON_CLEAN]
    header = _REPORT_HEADER.format(
        runs=num_runs, frames=clean.num_frames // num_runs, odometry=clean.odometry_max_m
    )
    sections = (_format_sweep(result) for result in results)
    return "\n".join([header, failure_table(results), *sections]) + "\n"


def failure_table(results: Sequence[SweepResult]) -> str:
    """Table of the first failing level of each sweep."""
    rows = []
    for result in results:
        by_training = _failure_levels_by_training(result)
        clean, retrained = by_training[TRAINED_ON_CLEAN], by_training[TRAINED_ON_DEGRADED]
        # The one way that has no column for the retrained classifier.
        del retrained["ekf_error_above_twice_clean"]
        failures = (*clean.values(), *retrained.values())
        span = f"{result.levels[0].label} … {result.levels[-1].label}"
        labels = (label or "–" for label in failures)
        rows.append([result.sweep.name, result.sweep.unit, span, *labels])
    return markdown_table(_FAILURE_HEADER, rows)


def format_sweep_summary(results: Sequence[SweepResult], *, num_runs: int, seed: int) -> str:
    """Sentence on the conditions, and a row with all levels of each sweep, for docs/EFFECTS.md."""
    clean = results[0].clean.metrics[TRAINED_ON_CLEAN]
    seeds = f"seeds {seed} to {seed + num_runs - 1}" if num_runs > 1 else f"seed {seed}"
    conditions = wrap_paragraph(
        f"Drives per level: {num_runs} of {clean.num_frames // num_runs} frames, {seeds}; beacons "
        "found → the filter's largest error, median of the drives, bold beyond the paper's "
        f"{PAPER_EKF_ERROR_M:g} m. Clean images: {_format_summary_cell(clean)}; odometry alone: "
        f"{clean.odometry_max_m:.2f} m."
    )
    # Not aligned: the widest cell has 150 characters.
    rows = (
        ("sweep", "levels: found → filter's largest error", "last level, retrained"),
        ("---",) * 3,
        *(_summary_row(result) for result in results),
    )
    return "\n".join((conditions, "", *(f"| {' | '.join(row)} |" for row in rows)))


def _summary_row(result: SweepResult) -> tuple[str, str, str]:
    levels = (
        f"{level.label}: {_format_summary_cell(level.metrics[TRAINED_ON_CLEAN])}"
        for level in result.levels
    )
    retrained = result.levels[-1].metrics[TRAINED_ON_DEGRADED]
    name = f"{result.sweep.name.lower()}: {result.sweep.unit}"
    return name, "; ".join(levels), _format_summary_cell(retrained)


def _format_summary_cell(metrics: DegradationMetrics) -> str:
    error = f"{metrics.ekf_max_m:.2f} m"
    if metrics.ekf_max_m > PAPER_EKF_ERROR_M:
        error = f"**{error}**"
    return f"{100.0 * metrics.detection_rate:.0f} % → {error}"


def _format_sweep(result: SweepResult) -> str:
    sweep = result.sweep
    sentence = f"{sweep.description[0].upper()}{sweep.description[1:]}."
    rows = []
    for level in _all_levels(result):
        metrics = level.metrics[TRAINED_ON_CLEAN]
        # Clean images have one classifier, which then stands in both halves of the row.
        retrained = _metrics(level, TRAINED_ON_DEGRADED)
        difference = f"{rms_difference(level.example, result.clean.example):.1f}"
        rows.append([level.label, difference, *_metric_cells(metrics), *_short_cells(retrained)])
    table = markdown_table((sweep.unit, *_LEVEL_HEADER), rows)
    return f"\n## {sweep.name}\n\n{sentence}\n\n{table}"


def _metric_cells(metrics: DegradationMetrics) -> tuple[str, ...]:
    bearing = "–" if metrics.bearing_rms_deg is None else f"{metrics.bearing_rms_deg:.2f}°"
    range_ = "–" if metrics.range_rms_m is None else f"{1e3 * metrics.range_rms_m:.0f} mm"
    found, false, largest = _short_cells(metrics)
    return found, false, bearing, range_, largest, f"{metrics.ekf_final_m:.2f} m"


def _short_cells(metrics: DegradationMetrics) -> tuple[str, str, str]:
    return (
        f"{metrics.detection_rate:.0%}",
        f"{metrics.false_per_frame:.2f}",
        f"{metrics.ekf_max_m:.2f} m",
    )
