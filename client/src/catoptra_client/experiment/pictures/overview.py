"""The whole story in one picture: a frame, the landmarks found in it, the path that they give."""

from __future__ import annotations

from pathlib import Path

from catoptra_client.experiment.pictures import style
from catoptra_client.experiment.pictures.classifier_view import draw_bearings
from catoptra_client.experiment.pictures.trajectories import draw_field, draw_paths
from catoptra_client.experiment.recording import DriveLog
from catoptra_client.experiment.replay import FilterRun
from catoptra_client.landmarks import Detector, DetectionStages
from catoptra_client.landmarks.histogram import UInt8Array


def draw_overview(
    path: Path, frame: UInt8Array, detector: Detector, *, stages: DetectionStages, logged_run: tuple[DriveLog, FilterRun]
) -> None:
    """Write the frame with its bearings beside the map of a drive."""
    recording, trace = logged_run
    with style.open_figure(path, figsize=(10.0, 5.4)) as drawing:
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
