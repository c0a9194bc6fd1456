"""The paper's Figure 13: distance between true and believed place, of a run and of all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_client.experiment.ensemble import error_bands
from catoptra_client.experiment.pictures import style
from catoptra_client.experiment.replay import Trace

_LIMIT_M = 0.6  # what the paper reports for the filter


def draw_errors(path: Path, panels: Sequence[tuple[str, Trace]]) -> None:
    """Write one plot for each (title, trace), with what the gate did in every step."""
    with style.figure(path, figsize=(5.6 * len(panels), 4.2)) as drawing:
        axes = drawing.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axis, (title, trace) in zip(axes, panels, strict=True):
            steps = np.arange(len(trace.estimate_error_m))
            axis.plot(steps, trace.odometry_error_m, color=style.ODOMETRY, label="odometry alone")
            axis.plot(steps, trace.estimate_error_m, color=style.ESTIMATE, label="EKF")
            _gate_marks(axis, trace)
            _finish(axis, title)
        axes[0].set_ylabel("position error in m")
        _legend(drawing, axes[0])


def _gate_marks(axis: Any, trace: Trace) -> None:
    """Mark below the axis which steps saw landmarks, and whether one passed the gate."""
    steps = np.arange(len(trace.seen))
    accepted, seen = trace.accepted > 0, trace.seen > 0
    for mask, colour, label in (
        (accepted, style.ACCEPTED, "landmark accepted"),
        (seen & ~accepted, style.REJECTED, "all landmarks rejected"),
    ):
        places = np.full(int(mask.sum()), -0.06)
        axis.plot(steps[mask], places, "|", color=colour, ms=7, mew=2, label=label)


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
            _finish(axis, title)
        axes[0].set_ylabel("position error in m")
        _legend(drawing, axes[0])


def _finish(axis: Any, title: str) -> None:
    axis.axhline(_LIMIT_M, color=style.MUTED, lw=1, ls="--")
    axis.text(100, _LIMIT_M + 0.02, "0.6 m", color=style.MUTED, ha="right", fontsize=8)
    axis.axhline(1.0, color=style.MUTED, lw=1, ls=":")
    axis.text(100, 1.02, "1 m", color=style.MUTED, ha="right", fontsize=8)
    axis.set_title(title)
    axis.set_xlabel("step")
    axis.set_xlim(0, 100)


def _legend(drawing: Any, axis: Any) -> None:
    handles, labels = axis.get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside lower center", ncols=4)
