"""The ladders of degraded pictures: how they look, what is found in them, what the filter errs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.degradation.example_frame import ExampleFrame, Pixel
from catoptra_studies.degradation.failure_levels import PAPER_EKF_ERROR_M
from catoptra_studies.experiment.plots import drive_plot_style

_NUM_COLUMNS = 4
_TRAINING_STYLES = (
    (TRAINED_ON_CLEAN, drive_plot_style.REJECTED, "o-", "taught by clean pictures"),
    (TRAINED_ON_DEGRADED, drive_plot_style.ACCEPTED, "s--", "taught anew by such pictures"),
)


def draw_sweep(path: Path, result: SweepResult) -> None:
    """Write a ladder's page: a sample of each rung above, rate and error below."""
    rungs = (result.clean, *result.levels)
    with drive_plot_style.open_figure(path, figsize=(2.9 * len(rungs), 6.6)) as drawing:
        above, below = drawing.subfigures(2, 1, height_ratios=(1.25, 1.0))
        above.suptitle(f"{result.sweep.name}: {result.sweep.description}\n", fontweight="bold")
        for axis, rung in zip(above.subplots(1, len(rungs)), rungs, strict=True):
            _draw_example(axis, rung.example)
            axis.set_title(_example_title(rung))
        rate, error = below.subplots(1, 2)
        draw_detection_rates(rate, result)
        draw_ekf_errors(error, result)
        for axis in (rate, error):
            axis.set_xlabel(result.sweep.unit)
        handles, labels = error.get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=3)


def draw_all_sweeps(path: Path, results: Sequence[SweepResult]) -> None:
    """Write the curves of all ladders: a pair of plots each, rate above error."""
    rows = math.ceil(len(results) / _NUM_COLUMNS)
    with drive_plot_style.open_figure(path, figsize=(4.0 * _NUM_COLUMNS, 4.6 * rows)) as drawing:
        cells = drawing.subfigures(rows, _NUM_COLUMNS, squeeze=False).flat
        for cell, result in zip(cells, results, strict=False):
            rate, error = cell.subplots(2, 1, sharex=True)
            draw_detection_rates(rate, result)
            draw_ekf_errors(error, result)
            rate.set_title(result.sweep.name)
            error.set_xlabel(result.sweep.unit)
        handles, labels = error.get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=3)


def draw_detection_rates(axes: Any, result: SweepResult) -> None:
    """Draw the share of visible beacons that was found, by rung."""
    for learnt, colour, line, label in _TRAINING_STYLES:
        shares = [100.0 * _metrics(rung, learnt).rate for rung in _levels(result)]
        axes.plot(_level_labels(result), shares, line, color=colour, label=label)
    axes.set_ylim(-4, 104)
    axes.set_ylabel("beacons found, %")


def draw_ekf_errors(axes: Any, result: SweepResult) -> None:
    """Draw the filter's largest error by rung, its limit, and odometry alone."""
    for learnt, colour, line, label in _TRAINING_STYLES:
        errors = [_metrics(rung, learnt).ekf_max_m for rung in _levels(result)]
        axes.plot(_level_labels(result), errors, line, color=colour, label=label)
    odometry = [_metrics(rung, TRAINED_ON_CLEAN).odometry_max_m for rung in _levels(result)]
    axes.plot(
        _level_labels(result),
        odometry,
        ":",
        color=drive_plot_style.ODOMETRY,
        label="odometry alone",
    )
    axes.axhline(PAPER_EKF_ERROR_M, color=drive_plot_style.MUTED, lw=1, ls="--")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("EKF's largest error, m")


def _levels(result: SweepResult) -> tuple[LevelResult, ...]:
    return (result.clean, *result.levels)


def _level_labels(result: SweepResult) -> list[str]:
    return [rung.label for rung in _levels(result)]


def _metrics(level: LevelResult, training: str) -> Any:
    return level.metrics.get(training, level.metrics[TRAINED_ON_CLEAN])


def _example_title(level: LevelResult) -> str:
    shown = level.example
    false = f", {len(shown.false_bearings_rad)} false" if shown.false_bearings_rad else ""
    return f"{level.label}\n{len(shown.detected_px)} of {len(shown.detected_px) + len(shown.missed_px)}{false}"


def _draw_example(axes: Any, example: ExampleFrame) -> None:
    """Draw the frame; a ring on each beacon found, a cross on one missed, a ray to a false one."""
    axes.imshow(example.rgb)
    _draw_markers(axes, example.detected_px, "o", "white")
    _draw_markers(axes, example.missed_px, "x", drive_plot_style.ODOMETRY)
    u, v = example.centre_px
    for bearing in example.false_bearings_rad:
        reach = 0.45 * example.rgb.shape[0]
        # The picture's top is forward, its right is right.
        ends = (u + reach * math.sin(bearing), v - reach * math.cos(bearing))
        axes.plot([u, ends[0]], [v, ends[1]], color=drive_plot_style.REJECTED, lw=1.5)
    axes.set_axis_off()


def _draw_markers(axes: Any, pixels: Sequence[Pixel], marker: str, colour: str) -> None:
    if pixels:
        u, v = zip(*pixels, strict=True)
        axes.plot(u, v, marker, color=colour, ms=11, mfc="none", mew=2.0)
