"""The experiment in one figure: a frame with the detected landmarks, and the localized path."""

from __future__ import annotations

from pathlib import Path

from catoptra_client.landmarks import DetectionStages, Detector
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_studies import plot_style
from catoptra_studies.experiment.drive_log import DriveLog
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.experiment.plots.classifier_plot import draw_bearings
from catoptra_studies.experiment.plots.trajectory_plot import (
    draw_field,
    draw_paths,
    widen_to_path,
)


def draw_overview(
    path: Path,
    rgb: UInt8Array,
    detector: Detector,
    *,
    stages: DetectionStages,
    logged_run: tuple[DriveLog, FilterRun],
) -> None:
    """Write the frame with its bearings beside the map of a drive.

    Args:
        path: PNG file to write.
        rgb: (h, w, 3) frame.
        detector: Detector that was used.
        stages: Results of all stages for this frame.
        logged_run: Drive for the map, and a filter's results over it.
    """
    drive_log, filter_run = logged_run
    with plot_style.open_chart(path, figsize=(plot_style.PAGE_WIDTH_IN, 4.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        draw_bearings(left, rgb, detector, stages)
        left.set_title("frame of the mirror camera, with the landmarks found")
        draw_field(right, detector.landmarks)
        draw_paths(right, drive_log, filter_run)
        widen_to_path(right, filter_run.odometry)
        right.set_title("localized by them on a drive of 100 steps")
        # The figure is shown small; the axes in metres are those of trajectories.png.
        right.set_xticks([])
        right.set_yticks([])
        right.spines[:].set_visible(False)
        right.legend(loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2, fontsize=7)
