"""The paper's Figure 13: distance between true and believed place, of a run and of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_client.experiment.ensemble import error_bands
from catoptra_client.experiment.pictures import style
from catoptra_client.experiment.replay import Trace

_FILTER_M = 0.6  # what the paper reports for the filter
_ODOMETRY_M = 1.0  # and what odometry alone rises above


def draw_errors(path: Path, panels: Sequence[tuple[str, Trace]]) -> None:
    """Write one plot for each (title, trace), and below it what the gate did in every step."""
    with style.figure(path, figsize=(5.6 * len(panels), 5.0)) as drawing:
        rows = {"height_ratios": (3.2, 1.0)}
        axes = drawing.subplots(
            2, len(panels), squeeze=False, sharey="row", sharex="col", gridspec_kw=rows
        )
        for (axis, gate_axis), (title, trace) in zip(axes.T, panels, strict=True):
            steps = np.arange(len(trace.estimate_error_m))
            axis.plot(steps, trace.odometry_error_m, color=style.ODOMETRY, label="odometry alone")
            axis.plot(steps, trace.estimate_error_m, color=style.ESTIMATE, label="EKF")
            _limits(axis, title)
            _gate_bars(gate_axis, trace)
        axes[0, 0].set_ylabel("position error in m")
        axes[1, 0].set_ylabel("landmarks")
        _legend(drawing, axes[0, 0], axes[1, 0])


def _gate_bars(axis: Any, trace: Trace) -> None:
    """Show for every step how many landmarks passed the gate, and how many did not."""
    steps = np.arange(len(trace.seen))
    rejected = trace.seen - trace.accepted
    axis.bar(steps, trace.accepted, width=0.9, color=style.ACCEPTED, label="accepted by the gate")
    axis.bar(steps, -rejected, width=0.9, color=style.REJECTED, label="rejected by the gate")
    axis.axhline(0.0, color=style.MUTED, lw=0.8)
    axis.set_xlabel("step")


def draw_ensemble(path: Path, panels: Sequence[tuple[str, Sequence[Trace]]]) -> None:
    """Write, for each (title, traces), the median error over the seeds with its 5..95 % band."""
    with style.figure(path, figsize=(5.6 * len(panels), 4.2)) as drawing:
        axes = drawing.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axis, (title, traces) in zip(axes, panels, strict=True):
            for of_odometry, colour, name in (
                (True, style.ODOMETRY, "odometry alone"),
                (False, style.ESTIMATE, "EKF"),
            ):
                low, median, high = error_bands(traces, of_odometry=of_odometry)
                steps = np.arange(len(median))
                axis.fill_between(steps, low, high, color=colour, alpha=0.18, lw=0)
                axis.plot(steps, median, color=colour, label=f"{name}, median of {len(traces)}")
            _limits(axis, title)
            axis.set_xlabel("step")
        axes[0].set_ylabel("position error in m")
        _legend(drawing, axes[0])


def _limits(axis: Any, title: str) -> None:
    """Draw the paper's two levels: what the filter keeps, and what odometry exceeds."""
    for level, words, line in ((_FILTER_M, "0.6 m", "--"), (_ODOMETRY_M, "1 m", ":")):
        axis.axhline(level, color=style.MUTED, lw=1, ls=line)
        axis.text(1, level + 0.02, words, color=style.MUTED, fontsize=8)
    axis.set_title(title)
    axis.set_xlim(0, 100.5)


def _legend(drawing: Any, *axes: Any) -> None:
    pairs = [axis.get_legend_handles_labels() for axis in axes]
    handles = [handle for pair in pairs for handle in pair[0]]
    labels = [label for pair in pairs for label in pair[1]]
    drawing.legend(handles, labels, loc="outside lower center", ncols=4)
