"""One frame of a film to look at, with what was found in it and what was missed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_studies.degradation.degradation_metrics import (
    DriveDetections,
    FrameEvaluation,
    evaluate_drive,
)
from catoptra_studies.degradation.recorded_drive import RecordedDrive

Pixel = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ExampleFrame:
    """A (h, w, 3) frame; where its beacons are that were found, and those missed; false ones.

    false_bearings_rad: bearings of detections of what is not there. centre_px: of the picture's mirror.
    """

    rgb: UInt8Array
    detected_px: tuple[Pixel, ...]
    missed_px: tuple[Pixel, ...]
    false_bearings_rad: tuple[float, ...]
    centre_px: Pixel


def select_example(drive: RecordedDrive, detections: DriveDetections) -> ExampleFrame:
    """Return the first of the frames that show most beacons within range."""
    judged = list(evaluate_drive(drive, detections))
    number = argmax_visible_beacons(judged)
    shot, frame = drive.frames[number], judged[number]
    places = {s.landmark.name: s.pixel for s in shot.landmarks if s.pixel is not None}
    return ExampleFrame(
        rgb=shot.rgb,
        detected_px=tuple(places[name] for name in sorted(frame.detection_errors)),
        missed_px=tuple(
            places[name] for name in sorted(frame.visible_beacons - set(frame.detection_errors))
        ),
        false_bearings_rad=tuple(one.bearing_rad for one in frame.false_detections),
        centre_px=drive.camera.centre_px,
    )


def rms_difference(degraded: ExampleFrame, clean: ExampleFrame) -> float:
    """Return the rms difference of two samples of the same place, in grey levels."""
    difference = degraded.rgb.astype(np.float64) - clean.rgb
    return float(np.sqrt(np.mean(np.square(difference))))


def argmax_visible_beacons(evaluations: Sequence[FrameEvaluation]) -> int:
    """Return the index of the first frame with the most visible beacons."""
    counts = [len(frame.visible_beacons) for frame in evaluations]
    return counts.index(max(counts))
