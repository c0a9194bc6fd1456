"""The whole story in one picture: a frame, the landmarks found in it, the path that they give."""

from __future__ import annotations

from pathlib import Path

from catoptra_client.landmarks import DetectionStages, Detector
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_studies.experiment.drive_log import DriveLog
from catoptra_studies.experiment.filter_replay import FilterRun
from catoptra_studies.experiment.plots import drive_plot_style
from catoptra_studies.experiment.plots.classifier_plot import draw_bearings
from catoptra_studies.experiment.plots.trajectory_plot import draw_field, draw_paths


def draw_overview(
    path: Path,
    frame: UInt8Array,
    detector: Detector,
    *,
    stages: DetectionStages,
    logged_run: tuple[DriveLog, FilterRun],
) -> None:
    """Write the frame with its bearings beside the map of a drive."""
    recording, trace = logged_run
    with drive_plot_style.open_figure(path, figsize=(10.0, 5.4)) as drawing:
        left, right = drawing.subplots(1, 2, width_ratios=(1.25, 1.0))
        draw_bearings(left, frame, detector, stages)
        left.set_title("what the mirror camera sees, with the landmarks found")
        draw_field(right, detector.landmarks)
        draw_paths(right, recording, trace)
        right.set_title("localised by them on a drive of 100 steps")
        right.set_xticks([])
        right.set_yticks([])
        right.spines[:].set_visible(False)
        right.legend(loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2, fontsize=8)
