"""Report of the degraded images: degradation.json, DEGRADATION.md and the plots."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics
from catoptra_studies.degradation.degradation_plot import draw_all_sweeps, draw_sweep
from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.degradation.example_frame import rms_difference
from catoptra_studies.degradation.failure_levels import FailureLevels, find_failure_levels
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M
from catoptra_studies.reports import markdown_table, wrap_paragraph

FORMAT_VERSION = 2

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
    summary = summarize_degradation(results, num_runs=config.num_runs, seed=config.seed)
    # A metric without values is None, so a nan here is a bug and has to raise.
    text = json.dumps(summary, indent=2, allow_nan=False)
    (output_folder / "degradation.json").write_text(text + "\n", encoding="utf-8")
    report = format_degradation_report(results, num_runs=config.num_runs)
    (output_folder / "DEGRADATION.md").write_text(report, encoding="utf-8")
    draw_all_sweeps(output_folder / "degradation.png", results)
    for result in results:
        draw_sweep(output_folder / f"degradation_{result.sweep.slug}.png", result)


def failure_levels_by_training(result: SweepResult) -> dict[str, FailureLevels]:
    """Failing levels of a sweep for both classifiers."""
    # Both are compared with the clean result of the one classifier that has seen clean images.
    clean = result.clean.metrics[TRAINED_ON_CLEAN]
    return {
        training: find_failure_levels(
            clean, [(level.label, level.metrics[training]) for level in result.levels]
        )
        for training in (TRAINED_ON_CLEAN, TRAINED_ON_DEGRADED)
    }


def summarize_degradation(
    results: Sequence[SweepResult], *, num_runs: int, seed: int
) -> dict[str, Any]:
    """All content of degradation.json."""
    return {
        "version": FORMAT_VERSION,
        "num_runs": num_runs,
        "seed": seed,
        "sweeps": [_summarize_sweep(result) for result in results],
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
            {**_summarize_level(measured, result), "ini_keys": level.ini_keys.split("|")}
            # Results beside the table: a result has the label of its level, not its keys.
            for measured, level in zip(result.levels, sweep.levels, strict=True)
        ],
        "failure_levels": {
            training: asdict(levels)
            for training, levels in failure_levels_by_training(result).items()
        },
    }


def _summarize_level(level: LevelResult, result: SweepResult) -> dict[str, Any]:
    return {
        "label": level.label,
        "rms_difference_grey_levels": _rms_difference(level, result),
        "trained_on": {
            training: {**asdict(metrics), "detection_rate": metrics.detection_rate}
            for training, metrics in level.metrics.items()
        },
    }


def _rms_difference(level: LevelResult, result: SweepResult) -> float:
    return rms_difference(level.example, result.clean.example)


def format_degradation_report(results: Sequence[SweepResult], *, num_runs: int) -> str:
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
        by_training = failure_levels_by_training(result)
        clean, retrained = by_training[TRAINED_ON_CLEAN], by_training[TRAINED_ON_DEGRADED]
        failures = (
            clean.detection_below_90_percent,
            clean.detection_below_50_percent,
            clean.ekf_error_above_twice_clean,
            clean.ekf_error_above_paper,
            retrained.detection_below_90_percent,
            retrained.detection_below_50_percent,
            retrained.ekf_error_above_paper,
        )
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
    for level in (result.clean, *result.levels):
        metrics = level.metrics[TRAINED_ON_CLEAN]
        # Clean images have one classifier, which then stands in both halves of the row.
        retrained = level.metrics.get(TRAINED_ON_DEGRADED, metrics)
        difference = f"{_rms_difference(level, result):.1f}"
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
