"""The paper's Figure 13: distance between true and estimated position, of one run and of all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from catoptra_studies import plot_style
from catoptra_studies.experiment.ensemble import error_quantiles
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M, PAPER_ODOMETRY_ERROR_M

_ESTIMATE_LABEL = "the paper's filter (EKF)"


def draw_position_errors(path: Path, panels: Sequence[tuple[str, FilterRun]]) -> None:
    """Write the errors of one run for each (title, run), above the decisions of the gate."""
    with plot_style.open_chart(path, figsize=(plot_style.PAGE_WIDTH_IN, 3.7)) as figure:
        # One scale for both set-ups, else the real odometry would look no worse than the simulated.
        grid = figure.subplots(
            2,
            len(panels),
            squeeze=False,
            sharey="row",
            sharex="col",
            gridspec_kw={"height_ratios": (3.2, 1.2)},
        )
        for (axes, gate_axes), (title, run) in zip(grid.T, panels, strict=True):
            steps = np.arange(len(run.estimate_error_m))
            odometry = {"color": plot_style.ODOMETRY, "label": "odometry alone"}
            axes.plot(steps, run.odometry_error_m, **odometry)
            axes.plot(steps, run.estimate_error_m, color=plot_style.ESTIMATE, label=_ESTIMATE_LABEL)
            _draw_paper_limits(axes, title)
            _draw_gate_bars(gate_axes, run)
        grid[0, 0].set_ylabel("position error, m")
        grid[1, 0].set_ylabel("landmarks")
        _set_integer_ticks(grid[1, 0])
        _draw_legend(figure, grid[0, 0], grid[1, 0])


def _set_integer_ticks(axes: plot_style.Axes) -> None:
    """Label whole landmarks, without a sign: those below the axis are rejected ones."""
    low, high = axes.get_ylim()
    # Even numbers alone: the panel is low.
    ticks = range(2 * math.ceil(low / 2), 2 * math.floor(high / 2) + 1, 2)
    axes.set_yticks(ticks, [str(abs(tick)) for tick in ticks])


def _draw_gate_bars(axes: plot_style.Axes, filter_run: FilterRun) -> None:
    """Draw accepted landmarks of each step upwards and rejected ones downwards."""
    steps = np.arange(len(filter_run.num_measured))
    accepted, rejected = (
        filter_run.num_accepted,
        filter_run.num_measured - filter_run.num_accepted,
    )
    # Rejections below the axis: a lock-out is then a block with nothing above.
    axes.bar(steps, accepted, 0.9, color=plot_style.ACCEPTED, label="accepted by the gate")
    axes.bar(steps, -rejected, 0.9, color=plot_style.REJECTED, label="rejected by the gate")
    axes.axhline(0.0, color=plot_style.MUTED, lw=0.8)
    axes.set_xlabel("step")


def draw_error_ensemble(path: Path, panels: Sequence[tuple[str, Sequence[FilterRun]]]) -> None:
    """Write the median error over the seeds with its band from 5 % to 95 %, for each panel."""
    with plot_style.open_chart(path, figsize=(plot_style.PAGE_WIDTH_IN, 3.0)) as figure:
        row = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axes, (title, filter_runs) in zip(row, panels, strict=True):
            for of_odometry, colour, name in (
                (True, plot_style.ODOMETRY, "odometry alone"),
                (False, plot_style.ESTIMATE, _ESTIMATE_LABEL),
            ):
                # Quantiles of each step for itself: no single run follows the band's edge.
                p05, median, p95 = error_quantiles(filter_runs, of_odometry=of_odometry)
                steps = np.arange(len(median))
                axes.fill_between(steps, p05, p95, color=colour, alpha=0.18, lw=0)
                label = f"{name}: median of {len(filter_runs)} runs, 5 % to 95 %"
                axes.plot(steps, median, color=colour, label=label)
            _draw_paper_limits(axes, title)
            axes.set_xlabel("step")
        row[0].set_ylabel("position error, m")
        _draw_legend(figure, row[0])


def _draw_paper_limits(axes: plot_style.Axes, title: str) -> None:
    """Draw the paper's bound of the filter, and the error that odometry exceeds."""
    for error_m, text, line in (
        (PAPER_EKF_ERROR_M, "0.6 m, the paper's bound of the filter", "--"),
        (PAPER_ODOMETRY_ERROR_M, "1 m, exceeded by the paper's odometry", ":"),
    ):
        axes.axhline(error_m, color=plot_style.MUTED, lw=1, ls=line)
        box = {"facecolor": plot_style.BACKGROUND, "edgecolor": "none", "pad": 0.5, "alpha": 0.8}
        axes.text(1, error_m + 0.03, text, color=plot_style.MUTED, fontsize=7, bbox=box, zorder=1)
    axes.set_title(title)
    # Half a step beyond the last, so that the bar of step 100 is drawn whole.
    axes.set_xlim(0, 100.5)


def _draw_legend(figure: plot_style.Page, *axes: plot_style.Axes) -> None:
    """Draw one legend for several axes below the figure."""
    pairs = [one.get_legend_handles_labels() for one in axes]
    handles = [handle for pair in pairs for handle in pair[0]]
    labels = [label for pair in pairs for label in pair[1]]
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
