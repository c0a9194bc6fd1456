"""Plots of the sweeps: example frames, detection rates and position errors by level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from catoptra_studies import plot_style
from catoptra_studies.degradation.degradation_metrics import DegradationMetrics
from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.degradation.example_frame import ExampleFrame, Pixel
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M

_NUM_COLUMNS = 4
_TRAINING_STYLES = (
    (TRAINED_ON_CLEAN, plot_style.REJECTED, "o-", "trained on clean images"),
    (TRAINED_ON_DEGRADED, plot_style.ACCEPTED, "s--", "retrained on such images"),
)


def draw_sweep(path: Path, result: SweepResult) -> None:
    """Write the plot of one sweep: an example of each level above rate and error."""
    levels = _all_levels(result)
    with plot_style.open_chart(path, figsize=(2.2 * len(levels), 5.0)) as figure:
        above, below = figure.subfigures(2, 1, height_ratios=(1.25, 1.0))
        above.suptitle(f"{result.sweep.name}: {result.sweep.description}\n", fontweight="bold")
        for axes, level in zip(above.subplots(1, len(levels)), levels, strict=True):
            _draw_example(axes, level.example)
            axes.set_title(_example_title(level))
        rate_axes, error_axes = below.subplots(1, 2)
        draw_detection_rates(rate_axes, result)
        draw_ekf_errors(error_axes, result)
        for axes in (rate_axes, error_axes):
            axes.set_xlabel(result.sweep.unit)
        # The error axes have every series; the rate axes lack odometry.
        handles, labels = error_axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)


def draw_all_sweeps(path: Path, results: Sequence[SweepResult]) -> None:
    """Write the curves of all sweeps, each a detection rate above a position error."""
    num_rows = math.ceil(len(results) / _NUM_COLUMNS)
    with plot_style.open_chart(path, figsize=(3.0 * _NUM_COLUMNS, 3.5 * num_rows)) as figure:
        cells = figure.subfigures(num_rows, _NUM_COLUMNS, squeeze=False).flat
        # The last row may have more cells than there are sweeps.
        for cell, result in zip(cells, results, strict=False):
            rate_axes, error_axes = cell.subplots(2, 1, sharex=True)
            draw_detection_rates(rate_axes, result)
            draw_ekf_errors(error_axes, result)
            rate_axes.set_title(result.sweep.name)
            error_axes.set_xlabel(result.sweep.unit)
        handles, labels = error_axes.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)


def draw_detection_rates(axes: plot_style.Axes, result: SweepResult) -> None:
    """Draw the percentage of visible beacons detected at each level."""
    for training, colour, line, label in _TRAINING_STYLES:
        rates = [100.0 * _metrics(level, training).detection_rate for level in _all_levels(result)]
        axes.plot(_level_labels(result), rates, line, color=colour, label=label)
    # Markers at 0 and 100 % would be cut in half.
    axes.set_ylim(-4, 104)
    axes.set_ylabel("beacons found, %")


def draw_ekf_errors(axes: plot_style.Axes, result: SweepResult) -> None:
    """Draw the filter's largest error at each level, the paper's bound, and odometry alone."""
    levels = _all_levels(result)
    for training, colour, line, label in _TRAINING_STYLES:
        errors_m = [_metrics(level, training).ekf_max_m for level in levels]
        axes.plot(_level_labels(result), errors_m, line, color=colour, label=label)
    odometry_m = [_metrics(level, TRAINED_ON_CLEAN).odometry_max_m for level in levels]
    axes.plot(
        _level_labels(result), odometry_m, ":", color=plot_style.ODOMETRY, label="odometry alone"
    )
    axes.axhline(PAPER_EKF_ERROR_M, color=plot_style.MUTED, lw=1, ls="--")
    axes.set_ylim(bottom=0.0)
    axes.set_ylabel("EKF's largest error, m")


def _all_levels(result: SweepResult) -> tuple[LevelResult, ...]:
    return (result.clean, *result.levels)


def _level_labels(result: SweepResult) -> list[str]:
    return [level.label for level in _all_levels(result)]


def _metrics(level: LevelResult, training: str) -> DegradationMetrics:
    # Both curves begin at the clean images, which have one classifier only.
    return level.metrics.get(training, level.metrics[TRAINED_ON_CLEAN])


def _example_title(level: LevelResult) -> str:
    example = level.example
    num_detected, num_false = len(example.detected_px), len(example.false_bearings_rad)
    false = f", {num_false} false" if num_false else ""
    return f"{level.label}\n{num_detected} of {num_detected + len(example.missed_px)}{false}"


def _draw_example(axes: plot_style.Axes, example: ExampleFrame) -> None:
    """Draw the frame: rings on detected beacons, crosses on missed ones, rays to false ones."""
    axes.imshow(example.rgb)
    _draw_markers(axes, example.detected_px, "o", "white")
    _draw_markers(axes, example.missed_px, "x", plot_style.ODOMETRY)
    u, v = example.centre_px
    reach_px = 0.45 * example.rgb.shape[0]
    for bearing_rad in example.false_bearings_rad:
        # Forward is up; bearings grow to the robot's right, which a mirror shows on the left.
        end = (u - reach_px * math.sin(bearing_rad), v - reach_px * math.cos(bearing_rad))
        axes.plot([u, end[0]], [v, end[1]], color=plot_style.REJECTED, lw=1.5)
    axes.set_axis_off()


def _draw_markers(axes: plot_style.Axes, pixels: Sequence[Pixel], marker: str, colour: str) -> None:
    if pixels:
        u, v = zip(*pixels, strict=True)
        axes.plot(u, v, marker, color=colour, ms=11, mfc="none", mew=2.0)
