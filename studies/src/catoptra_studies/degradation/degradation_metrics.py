"""Detection rates, measurement errors and position errors over recorded drives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks import Detection
from catoptra_client.localization import make_landmark_map
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.degradation.recorded_drive import RecordedDrive, add_measurements
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, PAPER_FILTER, ExperimentSetup
from catoptra_studies.experiment.localization_filter import FilterRun, replay_filter
from catoptra_studies.experiment.metrics import (
    RangeBearingPair,
    rms_range_bearing,
    true_range_bearing,
)

# Two sigmas of the bearing noise in the paper's filter: a detection farther off is of another
# object.
MATCH_TOLERANCE_RAD = math.radians(5.0)

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
class FrameEvaluation:
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
        for evaluation in evaluate_drive(drive, found)
    ]
    errors = [error for frame in evaluations for error in frame.detection_errors.values()]
    filter_runs = _run_filter(drives, detections, setup, landmarks)
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


def evaluate_drive(drive: RecordedDrive, detections: DriveDetections) -> Iterator[FrameEvaluation]:
    """Evaluate the detections in each frame of a drive."""
    # No frame belongs to the start: steps[0] is where the robot was put.
    for step, frame, found in zip(drive.log.steps[1:], drive.frames, detections, strict=True):
        visible = {p.landmark.name: p.landmark for p in frame.landmarks if p.visible}
        truth = {name: true_range_bearing(step, landmark) for name, landmark in visible.items()}
        beacons = {name for name, landmark in visible.items() if landmark.kind == "beacon"}
        yield evaluate_frame(truth, beacons, found)


def evaluate_frame(
    range_bearing: dict[str, RangeBearingPair],
    beacons: set[str],
    detections: Sequence[Detection],
) -> FrameEvaluation:
    """Compare the detections of one frame with the truth.

    Args:
        range_bearing: True range and bearing of all visible landmarks by name.
        beacons: Names of those that are beacons.
        detections: Detections in the frame.
    """
    # Beacons alone: the visible part of a goal has another centre than the goal.
    visible = frozenset(name for name in beacons if range_bearing[name][0] <= MAX_RANGE_M)
    errors, false_detections = {}, []
    for detection in detections:
        truth = range_bearing.get(detection.name)
        if truth is None:
            false_detections.append(detection)
            continue
        error_rad = wrap_angle(detection.bearing_rad - truth[1])
        if abs(error_rad) > MATCH_TOLERANCE_RAD:
            false_detections.append(detection)
        # A correct detection beyond the range in use is neither a success nor a failure.
        elif detection.name in visible:
            errors[detection.name] = (detection.range_m - truth[0], error_rad)
    return FrameEvaluation(visible, errors, tuple(false_detections))


def _run_filter(
    recorded_drives: Sequence[RecordedDrive],
    detections: Sequence[DriveDetections],
    setup: ExperimentSetup,
    landmarks: Sequence[Landmark],
) -> list[FilterRun]:
    landmark_map = make_landmark_map(landmarks)
    drive_logs = (
        add_measurements(drive, found)
        for drive, found in zip(recorded_drives, detections, strict=True)
    )
    return [replay_filter(log, setup, PAPER_FILTER, landmark_map) for log in drive_logs]


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))
