"""One frame of a drive to look at, with its detected, missed and false beacons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_studies.degradation.degradation_metrics import (
    DriveDetections,
    FrameEvaluation,
    evaluate_drive,
)
from catoptra_studies.degradation.recorded_drive import RecordedDrive

# Position (u, v) in the image.
Pixel = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ExampleFrame:
    """A frame with its evaluated detections."""

    rgb: UInt8Array
    """(h, w, 3) image."""

    detected_px: tuple[Pixel, ...]
    """True positions of the visible beacons that were detected."""

    missed_px: tuple[Pixel, ...]
    """True positions of the visible beacons that were not."""

    false_bearings_rad: tuple[float, ...]
    """Bearings of detections that match no visible landmark."""

    centre_px: Pixel
    """Centre of the mirror's image."""


def select_example(drive: RecordedDrive, detections: DriveDetections) -> ExampleFrame:
    """Select the first of the frames with the most visible beacons within range."""
    evaluations = list(evaluate_drive(drive, detections))
    # The same frame at every level: visibility is the same there, since the seeds are.
    index = argmax_visible_beacons(evaluations)
    frame, evaluation = drive.frames[index], evaluations[index]
    pixels = {p.landmark.name: p.pixel for p in frame.landmarks if p.pixel is not None}
    # Visible and within range: beacons out of range are neither detected nor missed.
    missed = evaluation.visible_beacons - set(evaluation.detection_errors)
    # Sorted by name: sets have no order, and the plots of two equal runs must be equal.
    return ExampleFrame(
        rgb=frame.rgb,
        detected_px=tuple(pixels[name] for name in sorted(evaluation.detection_errors)),
        missed_px=tuple(pixels[name] for name in sorted(missed)),
        false_bearings_rad=tuple(
            detection.bearing_rad for detection in evaluation.false_detections
        ),
        centre_px=drive.camera.centre_px,
    )


def rms_difference(degraded: ExampleFrame, clean: ExampleFrame) -> float:
    """Root mean square difference of two frames at the same pose, in grey levels."""
    difference = degraded.rgb.astype(np.float64) - clean.rgb
    return float(np.sqrt(np.mean(np.square(difference))))


def argmax_visible_beacons(evaluations: Sequence[FrameEvaluation]) -> int:
    """Index of the first frame with the most visible beacons."""
    counts = [len(evaluation.visible_beacons) for evaluation in evaluations]
    return counts.index(max(counts))
