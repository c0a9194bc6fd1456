"""The paper's Figure 13: distance between true and believed place, of a run and of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_studies.experiment.ensemble import error_quantiles
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.experiment.plots import drive_plot_style

_PAPER_EKF_ERROR_M = 0.6  # what the paper reports for the filter
_PAPER_ODOMETRY_ERROR_M = 1.0  # and what odometry alone rises above


def draw_position_errors(path: Path, panels: Sequence[tuple[str, FilterRun]]) -> None:
    """Write one plot for each (title, trace), and below it what the gate did in every step."""
    with drive_plot_style.open_figure(path, figsize=(5.6 * len(panels), 5.0)) as drawing:
        rows = {"height_ratios": (3.2, 1.0)}
        axes = drawing.subplots(
            2, len(panels), squeeze=False, sharey="row", sharex="col", gridspec_kw=rows
        )
        for (axis, gate_axis), (title, trace) in zip(axes.T, panels, strict=True):
            steps = np.arange(len(trace.estimate_error_m))
            axis.plot(
                steps,
                trace.odometry_error_m,
                color=drive_plot_style.ODOMETRY,
                label="odometry alone",
            )
            axis.plot(steps, trace.estimate_error_m, color=drive_plot_style.ESTIMATE, label="EKF")
            _draw_paper_limits(axis, title)
            _draw_gate_bars(gate_axis, trace)
        axes[0, 0].set_ylabel("position error in m")
        axes[1, 0].set_ylabel("landmarks")
        _draw_legend(drawing, axes[0, 0], axes[1, 0])


def _draw_gate_bars(axes: Any, filter_run: FilterRun) -> None:
    """Show for every step how many landmarks passed the gate, and how many did not."""
    steps = np.arange(len(filter_run.num_measured))
    rejected = filter_run.num_measured - filter_run.num_accepted
    axes.bar(
        steps,
        filter_run.num_accepted,
        width=0.9,
        color=drive_plot_style.ACCEPTED,
        label="accepted by the gate",
    )
    axes.bar(
        steps, -rejected, width=0.9, color=drive_plot_style.REJECTED, label="rejected by the gate"
    )
    axes.axhline(0.0, color=drive_plot_style.MUTED, lw=0.8)
    axes.set_xlabel("step")


def draw_error_ensemble(path: Path, panels: Sequence[tuple[str, Sequence[FilterRun]]]) -> None:
    """Write, for each (title, traces), the median error over the seeds with its 5..95 % band."""
    with drive_plot_style.open_figure(path, figsize=(5.6 * len(panels), 4.2)) as drawing:
        axes = drawing.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axis, (title, traces) in zip(axes, panels, strict=True):
            for of_odometry, colour, name in (
                (True, drive_plot_style.ODOMETRY, "odometry alone"),
                (False, drive_plot_style.ESTIMATE, "EKF"),
            ):
                low, median, high = error_quantiles(traces, of_odometry=of_odometry)
                steps = np.arange(len(median))
                axis.fill_between(steps, low, high, color=colour, alpha=0.18, lw=0)
                axis.plot(steps, median, color=colour, label=f"{name}, median of {len(traces)}")
            _draw_paper_limits(axis, title)
            axis.set_xlabel("step")
        axes[0].set_ylabel("position error in m")
        _draw_legend(drawing, axes[0])


def _draw_paper_limits(axes: Any, title: str) -> None:
    """Draw the paper's two levels: what the filter keeps, and what odometry exceeds."""
    for level, words, line in (
        (_PAPER_EKF_ERROR_M, "0.6 m", "--"),
        (_PAPER_ODOMETRY_ERROR_M, "1 m", ":"),
    ):
        axes.axhline(level, color=drive_plot_style.MUTED, lw=1, ls=line)
        axes.text(1, level + 0.02, words, color=drive_plot_style.MUTED, fontsize=8)
    axes.set_title(title)
    axes.set_xlim(0, 100.5)


def _draw_legend(figure: Any, *axes: Any) -> None:
    pairs = [axis.get_legend_handles_labels() for axis in axes]
    handles = [handle for pair in pairs for handle in pair[0]]
    labels = [label for pair in pairs for label in pair[1]]
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
