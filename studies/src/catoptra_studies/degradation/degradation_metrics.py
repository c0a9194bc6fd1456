"""Metrics of one detector over recorded drives, an example frame, and the levels that fail.

Detections are compared with the landmarks that the stream reports as visible. A level fails where
the detector loses too many of the beacons found in clean images, or where the paper's filter
errs too much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks import Detection
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.localization import make_landmark_map
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.degradation.recorded_drive import (
    LabelledFrame,
    RecordedDrive,
    add_measurements,
)
from catoptra_studies.experiment.drive_log import DriveStep
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, PAPER_FILTER, ExperimentSetup
from catoptra_studies.experiment.localization_filter import replay_filter
from catoptra_studies.experiment.metrics import (
    RangeBearingPair,
    rms_range_bearing,
    true_range_bearing,
)
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M

# Two sigmas of the bearing noise in the paper's filter: a detection farther off is of another
# object.
_MATCH_TOLERANCE_RAD = math.radians(5.0)

# Detections in each frame of a drive.
DriveDetections = Sequence[Sequence[Detection]]


@dataclass(frozen=True, slots=True)
class DegradationMetrics:
    """Metrics of one detector over several drives."""

    num_frames: int

    num_visible: int
    """Beacons that the stream reports as visible, within the range in use."""

    num_detected: int
    """Visible beacons detected within MATCH_TOLERANCE_RAD of their bearing."""

    false_per_frame: float
    """Detections a frame that match no visible landmark."""

    bearing_rms_deg: float | None
    """Error of the detected beacons; None where none was detected."""

    range_rms_m: float | None

    ekf_max_m: float
    """Largest position error of the paper's filter; median over the drives."""

    ekf_final_m: float
    """Position error at the end, likewise."""

    odometry_max_m: float
    """Largest position error of odometry alone, likewise."""

    @property
    def detection_rate(self) -> float:
        """Fraction of the visible beacons that were detected; 0 where none was visible."""
        return self.num_detected / self.num_visible if self.num_visible else 0.0


@dataclass(frozen=True, slots=True)
class _FrameEvaluation:
    """Detections of one frame compared with the landmarks in view."""

    visible_beacons: frozenset[str]

    detection_errors: dict[str, RangeBearingPair]
    """Errors of the detected beacons by name: range in m, bearing in rad."""

    false_detections: tuple[Detection, ...]


def compute_degradation_metrics(
    drives: Sequence[RecordedDrive],
    detections: Sequence[DriveDetections],
    *,
    setup: ExperimentSetup,
    landmarks: Sequence[Landmark],
) -> DegradationMetrics:
    """Compute the metrics of one detector.

    Args:
        drives: Drives with their frames.
        detections: Detections in each frame of each drive.
        setup: Set-up of the drives, for the start of the filter.
        landmarks: All landmarks of the field.
    """
    evaluations = [
        evaluation
        for drive, found in zip(drives, detections, strict=True)
        for evaluation in _evaluate_drive(drive, found)
    ]
    errors = [error for frame in evaluations for error in frame.detection_errors.values()]
    landmark_map = make_landmark_map(landmarks)
    filter_runs = [
        replay_filter(add_measurements(drive, found), setup, PAPER_FILTER, landmark_map)
        for drive, found in zip(drives, detections, strict=True)
    ]
    range_m, bearing_rad = rms_range_bearing(errors)
    return DegradationMetrics(
        num_frames=len(evaluations),
        num_visible=sum(len(frame.visible_beacons) for frame in evaluations),
        num_detected=len(errors),
        false_per_frame=sum(len(frame.false_detections) for frame in evaluations)
        / len(evaluations),
        bearing_rms_deg=math.degrees(bearing_rad) if errors else None,
        range_rms_m=range_m if errors else None,
        ekf_max_m=_median([run.estimate_error_m.max() for run in filter_runs]),
        ekf_final_m=_median([run.estimate_error_m[-1] for run in filter_runs]),
        odometry_max_m=_median([run.odometry_error_m.max() for run in filter_runs]),
    )


def _evaluate_drive(
    drive: RecordedDrive, detections: DriveDetections
) -> Iterator[_FrameEvaluation]:
    """Evaluate the detections in each frame of a drive."""
    # No frame belongs to the start: steps[0] is where the robot was put.
    for step, frame, found in zip(drive.log.steps[1:], drive.frames, detections, strict=True):
        yield _evaluate_frame(step, frame, found)


def _evaluate_frame(
    step: DriveStep, frame: LabelledFrame, detections: Sequence[Detection]
) -> _FrameEvaluation:
    """Compare the detections of one frame with the truth."""
    visible = [projection.landmark for projection in frame.landmarks if projection.visible]
    truths = {landmark.name: true_range_bearing(step, landmark) for landmark in visible}
    # Beacons alone: the visible part of a goal has another centre than the goal.
    beacons = frozenset(
        landmark.name
        for landmark in visible
        if landmark.kind == "beacon" and truths[landmark.name][0] <= MAX_RANGE_M
    )
    errors, false_detections = {}, []
    for detection in detections:
        truth = truths.get(detection.name)
        if truth is None:
            false_detections.append(detection)
            continue
        error_rad = wrap_angle(detection.bearing_rad - truth[1])
        if abs(error_rad) > _MATCH_TOLERANCE_RAD:
            false_detections.append(detection)
        # A correct detection beyond the range in use is neither a success nor a failure.
        elif detection.name in beacons:
            errors[detection.name] = (detection.range_m - truth[0], error_rad)
    return _FrameEvaluation(beacons, errors, tuple(false_detections))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


# Position (u, v) in the image.
Pixel = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class ExampleFrame:
    """A frame with evaluated detections."""

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
    evaluations = list(_evaluate_drive(drive, detections))
    # The same frame at every level: visibility is the same there, since the seeds are.
    counts = [len(evaluation.visible_beacons) for evaluation in evaluations]
    index = counts.index(max(counts))
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


_IsFailure = Callable[[DegradationMetrics, DegradationMetrics], bool]

# Ways in which a level can fail, by its metrics and those of clean images: relative to these, in
# which the detector does not find every beacon either.
_FAILURES: Mapping[str, _IsFailure] = {
    "detection_below_90_percent": lambda m, clean: m.detection_rate < 0.9 * clean.detection_rate,
    "detection_below_50_percent": lambda m, clean: m.detection_rate < 0.5 * clean.detection_rate,
    "ekf_error_above_twice_clean": lambda m, clean: m.ekf_max_m > 2.0 * clean.ekf_max_m,
    "ekf_error_above_paper": lambda m, _: m.ekf_max_m > PAPER_EKF_ERROR_M,
}


def find_failure_levels(
    clean: DegradationMetrics, levels: Sequence[tuple[str, DegradationMetrics]]
) -> dict[str, str | None]:
    """Label of the first level of a sweep that fails in each way; None where all levels pass.

    Args:
        clean: Metrics of clean images.
        levels: Label and metrics of each level, from slight to hopeless.
    """
    # The first one, even if a later level passes again: a detector must not be trusted beyond.
    return {
        name: next((label for label, metrics in levels if is_failure(metrics, clean)), None)
        for name, is_failure in _FAILURES.items()
    }
