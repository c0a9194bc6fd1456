"""The paper's Figure 12: true path, odometry alone and the filter's estimate on the field."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from catoptra_protocol.landmarks import Landmark
from catoptra_studies.experiment.drive_log import DriveLog, true_positions
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.experiment.plots import drive_plot_style

TrajectoryPanel = tuple[str, DriveLog, FilterRun]


def draw_trajectories(
    path: Path, panels: Sequence[TrajectoryPanel], landmarks: Sequence[Landmark]
) -> None:
    """Write a map for each (title, recording, trace); the world's x points up, y to the right."""
    with drive_plot_style.open_figure(path, figsize=(4.9 * len(panels), 7.0)) as drawing:
        axes = drawing.subplots(1, len(panels), squeeze=False)[0]
        for axis, (title, recording, trace) in zip(axes, panels, strict=True):
            draw_field(axis, landmarks)
            draw_paths(axis, recording, trace)
            axis.set_title(title)
            axis.set_xlabel("y in m (right)")
        axes[0].set_ylabel("x in m (up)")
        handles, labels = axes[0].get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=4)


def draw_paths(axes: Any, drive_log: DriveLog, filter_run: FilterRun) -> None:
    """Draw true path, odometry and estimate of one drive."""
    truth = true_positions(drive_log)
    axes.plot(truth[:, 1], truth[:, 0], color=drive_plot_style.TRUTH, lw=1.6, label="true path")
    odometry, estimate = filter_run.odometry, filter_run.estimate
    axes.plot(
        odometry[:, 1],
        odometry[:, 0],
        color=drive_plot_style.ODOMETRY,
        lw=1.3,
        label="odometry alone",
    )
    axes.plot(estimate[:, 1], estimate[:, 0], color=drive_plot_style.ESTIMATE, lw=1.3, label="EKF")
    used = filter_run.num_accepted > 0
    axes.plot(
        *(estimate[used][:, 1], estimate[used][:, 0], "."),
        color=drive_plot_style.ACCEPTED,
        ms=4,
        label="step with an accepted landmark",
    )
    axes.plot(
        truth[0, 1], truth[0, 0], "o", color=drive_plot_style.TRUTH, ms=7, mfc="white", zorder=5
    )


def draw_field(axes: Any, landmarks: Sequence[Landmark]) -> None:
    """Draw the field from above: lines, and every landmark in its upper colour."""
    axes.plot([-1.8, 1.8, 1.8, -1.8, -1.8], [-2.7, -2.7, 2.7, 2.7, -2.7], color="#c4c9d0", lw=1)
    axes.plot([-1.8, 1.8], [0, 0], color="#c4c9d0", lw=1)
    for landmark in landmarks:
        lower = drive_plot_style.LANDMARK_COLOURS[landmark.lower_colour]
        upper = drive_plot_style.LANDMARK_COLOURS[landmark.upper_colour]
        if landmark.kind == "goal":
            half = 0.5 * landmark.width_m
            ends = [landmark.y_m - half, landmark.y_m + half]
            axes.plot(ends, [landmark.x_m] * 2, color=upper, lw=5, solid_capstyle="butt")
        else:
            axes.plot(landmark.y_m, landmark.x_m, "o", ms=11, mfc=lower, mec=upper, mew=3.5)
    axes.set_aspect("equal")
    axes.set_xlim(-2.7, 2.7)
    axes.set_ylim(-3.3, 3.5)
